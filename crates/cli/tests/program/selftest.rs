//! The self-test on a device: nothing is off, and what a broken device answers is found.

use std::process::{Command, Output};

use crate::common::project::program;
use crate::common::{assert_silent, device, samples_on};
use raywave_studies::selftest::{Bench, Verdict, checks};
use serde_json::Value;

#[test]
fn nothing_is_off() {
    let device = device();
    // In full where it is fast; and by hand, and by `.ci/run`, everywhere.
    let bench = Bench::new(&device).thinned(1600 / samples_on(&device, 1600));
    let rows: Vec<_> = checks().map(|check| check.run(&bench)).collect();
    let off: Vec<_> = rows.iter().filter(|row| row.verdict == Verdict::Off).collect();
    assert!(off.is_empty(), "{off:#?}");
    for row in &rows {
        assert!(row.cases > 0 || row.verdict == Verdict::Property, "{} checks nothing", row.name);
    }
    assert_silent(&device);
}

/// Changes a bit of every word of some answers in the middle.
fn flip_bits(_kernel: &str, answers: &mut [u8]) {
    let middle = (answers.len() / 2) & !3;
    answers[middle..][..96].chunks_exact_mut(4).for_each(|word| word[2] ^= 0x40);
}

/// Spoils what kernels count at the start of their answers: a case that is far from right, a ray that is lost.
fn count_a_fault(kernel: &str, answers: &mut [u8]) {
    match kernel {
        "quotients" | "reciprocals" | "roots" => (0..3).for_each(|word| answers[4 * word] = 1),
        "edges" => answers[0] = 1,
        _ => {}
    }
}

#[test]
fn a_broken_device_is_found() {
    let device = device();
    let run = |name: &str, fault| {
        let check = checks().find(|check| check.name == name).expect("it is a check");
        check.run(&Bench::new(&device).thinned(16).with_fault(fault))
    };
    for name in ["add", "multiply", "contraction", "integers", "append", "atomics", "barriers", "watertight"] {
        let row = run(name, flip_bits);
        assert_eq!(row.verdict, Verdict::Off, "{row:#?}");
        assert!(!row.spoils.is_empty() && !row.found.is_empty(), "{row:#?}");
    }
    for name in ["divide", "reciprocal", "root", "watertight"] {
        let row = run(name, count_a_fault);
        assert_eq!(row.verdict, Verdict::Off, "{row:#?}");
        assert!(!row.spoils.is_empty(), "{row:#?}");
    }
    let zeros = |_: &str, answers: &mut [u8]| answers.fill(0);
    for name in ["conversions", "halves", "nan-and-zeros", "min-max", "ballots", "indirect", "loops"] {
        let row = run(name, zeros);
        let is_there = name != "ballots" || device.description().subgroup_ballot;
        assert_eq!(row.verdict == Verdict::Off, is_there, "{row:#?}");
    }
    assert_silent(&device);
}

fn selftest(arguments: &[&str]) -> Output {
    let mut command = Command::new(program());
    command.arg("selftest").args(arguments).env("RAYWAVE_CACHE", "off");
    command.output().expect("the program starts")
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("the program writes UTF-8")
}

#[test]
fn the_report_is_a_table_or_json() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("selftest.json");
    let output = selftest(&["--only", "integers,fma", "--json", file.to_str().expect("a plain path")]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.starts_with(concat!("raywave ", env!("CARGO_PKG_VERSION"), "\n")), "{table}");
    for word in
        ["driver", "Vulkan", "subgroup", "workgroup", "storage buffer", "ok        integers", " fma ", "2 checks"]
    {
        assert!(table.contains(word), "no {word} in\n{table}");
    }

    let written: Value = serde_json::from_slice(&std::fs::read(&file).expect("the file is there")).expect("it is JSON");
    let output = selftest(&["--only", "integers,fma", "--json"]);
    let printed: Value = serde_json::from_slice(&output.stdout).expect("stdout is JSON");
    for report in [&written, &printed] {
        assert_eq!(report["provenance"]["raywave_version"], env!("CARGO_PKG_VERSION"));
        assert!(report["limits"]["max_workgroup_size"].as_u64().is_some_and(|size| size >= 128));
        let rows = report["rows"].as_array().expect("rows are a list");
        // In the report's order, whatever the wish's.
        let names: Vec<_> = rows.iter().map(|row| row["name"].as_str().expect("a name")).collect();
        assert_eq!(names, ["fma", "integers"]);
        assert_eq!(rows[1]["verdict"], "ok");
        assert_eq!(rows[1]["numbers"]["wrong"], 0);
        assert!(rows[1]["cases"].as_u64().is_some_and(|cases| cases > 1 << 18));
    }
}

#[test]
fn wrong_arguments_are_told_and_a_list_needs_no_device() {
    let output = selftest(&["--only", "addition"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--only addition is no check; the checks are add, "));
    let output = selftest(&["--list", "--device", "no such device"]);
    assert!(output.status.success());
    assert_eq!(text(&output.stdout).lines().count(), checks().count());
    let output = selftest(&["--json", "no/such/folder/file.json"]);
    assert_eq!(output.status.code(), Some(2));
}
