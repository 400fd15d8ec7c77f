"use strict";

// Theme: the system's, until the reader chooses.
document.getElementById("theme").addEventListener("click", () => {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
});

// Tables: a heading sorts by its column, and the other way round the second time.
for (const table of document.querySelectorAll("table.sortable")) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => heading.addEventListener("click", () => {
    const ascending = heading.getAttribute("aria-sort") !== "ascending";
    headings.forEach((other) => other.removeAttribute("aria-sort"));
    heading.setAttribute("aria-sort", ascending ? "ascending" : "descending");
    const key = (row) => row.cells[column].dataset.key;
    const rows = [...table.tBodies[0].rows];
    rows.sort((a, b) => {
      // What has no value comes last, whichever way.
      if (!key(a) || !key(b)) return !key(a) - !key(b);
      const order = key(a).localeCompare(key(b));
      const [x, y] = [Number(key(a)), Number(key(b))];
      return (Number.isNaN(x) || Number.isNaN(y) ? order : x - y) * (ascending ? 1 : -1);
    });
    table.tBodies[0].append(...rows);
  }));
}

// Tabs: one scene at a time, arrow keys go from one to the next.
const tabs = [...document.querySelectorAll("[role=tab]")];
const choose = (chosen) => tabs.forEach((tab) => {
  const on = tab === chosen;
  const panel = document.getElementById(tab.getAttribute("aria-controls"));
  tab.setAttribute("aria-selected", on);
  tab.tabIndex = on ? 0 : -1;
  panel.setAttribute("role", "tabpanel");
  panel.setAttribute("aria-labelledby", tab.id);
  panel.hidden = !on;
});
tabs.forEach((tab, i) => {
  tab.addEventListener("click", () => choose(tab));
  tab.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = tabs[(i + step + tabs.length) % tabs.length];
    choose(next);
    next.focus();
  });
});
if (tabs.length) choose(tabs[0]);

// Images: a range input over the pair moves the divider, by pointer, touch and keyboard alike.
const uris = JSON.parse(document.getElementById("image-uris").textContent);
for (const figure of document.querySelectorAll("figure.images")) {
  const find = (selector) => figure.querySelector(selector);
  const stage = find(".stage");
  const split = find(".split");
  const slide = () => stage.style.setProperty("--split", split.value + "%");
  const show = () => {
    const { label, dataset } = find("select").selectedOptions[0];
    const difference = find(".heat-switch").checked && dataset.heat !== "";
    find("img.left").src = uris[dataset.left];
    find("img.left").alt = dataset.base;
    find("img.right").src = uris[dataset.right];
    find("img.right").alt = label;
    find("img.heat").hidden = !difference;
    if (dataset.heat) find("img.heat").src = uris[dataset.heat];
    else find("img.heat").removeAttribute("src");
    find(".heat-switch").disabled = dataset.heat === "";
    find(".base").textContent = dataset.base;
    find(".tag.left").textContent = dataset.base;
    find(".tag.right").textContent = label;
    find(".note").textContent = dataset.note;
    stage.classList.toggle("difference", difference);
  };
  split.addEventListener("input", slide);
  find("select").addEventListener("change", show);
  find(".heat-switch").addEventListener("change", show);
  slide();
  show();
}
