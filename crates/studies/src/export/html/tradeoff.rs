//! The page of a sweep: error against time, what knobs are worth, and the images along the front.

use super::images::{PageImages, image_figure};
use super::page::{Frame, Page, legend};
use super::svg::{Anchor, Axis, Spacing, Svg, escape};
use super::table::{Cell, table};
use crate::export::numbers::{Unit, bounds, power_of_ten, seconds, small, small_interval};
use crate::export::plain;
use crate::export::tradeoff::{findings, knob_label, reference_text};
use crate::stats::{Estimate, Interval, compare_images};
use crate::studies::Provenance;
use crate::studies::tradeoff::{Decomposition, KnobReport, PointReport, Stage, TradeoffReport, Worth};

const WIDTH: f64 = 960.0;

/// The page of a sweep.
pub fn page(report: &TradeoffReport, provenance: &Provenance, page: &mut Page) -> String {
    let mut page_images = page.images();
    let images = images(report, &mut page_images);
    let title = escape(&report.facts.scene);
    let frame = Frame {
        command: "tradeoff",
        title: &title,
        heading: &title,
        unfinished: (!report.complete).then_some("This sweep was not finished. The page shows what it had so far."),
        findings: findings(report).iter().map(|text| escape(text)).collect(),
        style: "",
        main: [curve_section(report), knobs(report), images, points(report)].concat(),
        provenance: entries(report),
    };
    frame.html(provenance, page_images.into_uris())
}

fn class(point: &PointReport) -> &'static str {
    match (point.on_front, point.stage) {
        (true, _) => "faster",
        (false, Stage::OneKnob) => "noise",
        (false, Stage::Combined) => "k3",
        (false, Stage::Target) => "slower",
    }
}

/// Points that a logarithmic plot can show.
fn shown(report: &TradeoffReport) -> Vec<(&PointReport, Estimate, Estimate)> {
    let known = |point: &'_ PointReport| Some((point.seconds?, point.rel_mse?.total));
    let all = report.points.iter().filter_map(|point| known(point).map(|(seconds, error)| (point, seconds, error)));
    all.filter(|(point, seconds, error)| point.failed.is_none() && seconds.value > 0.0 && error.value > 0.0).collect()
}

fn curve_section(report: &TradeoffReport) -> String {
    let shown = shown(report);
    if shown.is_empty() {
        return String::new();
    }
    let entries = [
        ("faster", "on the front"),
        ("noise", "one knob turned"),
        ("k3", "combined"),
        ("slower", "towards the target"),
    ];
    let entries = entries.into_iter().map(|(class, name)| (class.to_owned(), name));
    format!(
        "<section id=\"curve\"><h2>Error against time</h2>\n<p>Each mark is a point of the sweep with its {:.0} % intervals; \
         the line joins those that no other is faster and nearer than. Point at a mark for its settings.</p>\n\
         <figure><figcaption>relMSE over the time of a render{}</figcaption>{}</figure></section>\n",
        100.0 * report.confidence,
        legend(entries),
        curve(report, &shown)
    )
}

/// Powers of ten between the two, and 2 and 5 times them where those are few.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let of = |mantissas: &[f64]| -> Vec<f64> {
        let all = powers.clone().flat_map(|power| mantissas.iter().map(move |m| m * 10_f64.powi(power)));
        all.filter(|tick| (low..=high).contains(tick)).collect()
    };
    let few = of(&[1.0]);
    if few.len() > 2 { few } else { of(&[1.0, 2.0, 5.0]) }
}

fn curve(report: &TradeoffReport, shown: &[(&PointReport, Estimate, Estimate)]) -> String {
    let (left, right, top, bottom) = (76.0, WIDTH - 20.0, 24.0, 424.0);
    let least = |values: &mut dyn Iterator<Item = f64>| values.filter(|v| *v > 0.0).fold(f64::INFINITY, f64::min);
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    // Whiskers may reach to 0 and below: there they end at the axis.
    let x_low = least(&mut shown.iter().map(|(_, seconds, _)| seconds.lowest())) / 1.25;
    let x_high = most(&mut shown.iter().map(|(_, seconds, _)| seconds.highest())) * 1.25;
    let y_low = least(&mut shown.iter().map(|(_, _, error)| error.value)) / 2.0;
    let y_high = most(&mut shown.iter().map(|(_, _, error)| error.highest())) * 1.5;
    let x = Axis { low: x_low, high: x_high, start: left, end: right, spacing: Spacing::Logarithmic };
    let y = Axis { low: y_low, high: y_high, start: bottom, end: top, spacing: Spacing::Logarithmic };
    let mut svg = Svg::new(WIDTH, bottom + 48.0);
    svg.text("panel", (left, 12.0), Anchor::Start, "relMSE (logarithmic)");
    for tick in ticks(y_low, y_high) {
        svg.line("grid", (left, y.at(tick)), (right, y.at(tick)));
        svg.text("tick", (left - 8.0, y.at(tick) + 4.0), Anchor::End, &format!("{tick:.0e}"));
    }
    for tick in ticks(x_low, x_high) {
        svg.line("grid", (x.at(tick), top), (x.at(tick), bottom));
        svg.text("tick", (x.at(tick), bottom + 16.0), Anchor::Middle, &seconds(tick));
    }
    svg.line("base", (left, bottom), (right, bottom));
    svg.text("axis", ((left + right) / 2.0, bottom + 36.0), Anchor::Middle, "device's time of a render (logarithmic)");
    let place = |seconds: &Estimate, error: &Estimate| (x.at(seconds.value), y.at(error.value));
    let on_front = report.front.iter().filter_map(|i| {
        let point = &report.points[*i];
        Some(place(point.seconds.as_ref()?, &point.rel_mse.as_ref().filter(|error| error.total.value > 0.0)?.total))
    });
    svg.polyline("series faster", &on_front.collect::<Vec<_>>());
    for (point, time, error) in shown {
        let (class, (cx, cy)) = (class(point), place(time, error));
        let whisker = format!("whisker {class}");
        if let Some(Interval { low, high }) = error.interval {
            svg.line(&whisker, (cx, y.at(low.max(y_low))), (cx, y.at(high)));
        }
        if let Some(Interval { low, high }) = time.interval {
            svg.line(&whisker, (x.at(low), cy), (x.at(high), cy));
        }
        let tip = format!("{}: {}, relMSE {}", point.full_label(), seconds(time.value), small_interval(error));
        svg.circle(class, (cx, cy), if point.on_front { 5.0 } else { 3.5 }, &tip);
    }
    if let Some(answer) = &report.target
        && (y_low..=y_high).contains(&answer.rel_mse)
    {
        svg.line("cross", (left, y.at(answer.rel_mse)), (right, y.at(answer.rel_mse)));
        svg.text("value", (right, y.at(answer.rel_mse) - 5.0), Anchor::End, "wanted");
    }
    svg.finish("relMSE of each point over the time of its render")
}

fn knobs(report: &TradeoffReport) -> String {
    if report.knobs.is_empty() {
        return String::new();
    }
    let columns = [
        ("knob", ""),
        ("worth", ""),
        ("time to equal variance", "of the base's"),
        ("time", "of the base's"),
        ("bias²", "in relMSE"),
        ("mean shift", "of the mean"),
        ("pays above", "relMSE"),
    ]
    .map(|(name, unit)| (name.to_owned(), unit));
    let row = |knob: &KnobReport| {
        let ratio_bounds = |e: &Estimate| Some(bounds(e, |v| format!("{v:.3}")));
        let small_bounds = |e: &Estimate| Some(bounds(e, small));
        let class = if knob.worth == Worth::Never { "failed" } else { "" };
        let cells = vec![
            Cell::text(&knob_label(knob)),
            Cell::text(knob.worth.words()),
            Cell::number(Some(knob.cost_ratio.value), |v| format!("{v:.3}"))
                .with_interval(ratio_bounds(&knob.cost_ratio)),
            Cell::number(Some(knob.time_ratio.value), |v| format!("{v:.3}"))
                .with_interval(ratio_bounds(&knob.time_ratio)),
            Cell::number(Some(knob.bias_squared.value), |v| if knob.identical { "none".to_owned() } else { small(v) })
                .with_interval((!knob.identical).then(|| small_bounds(&knob.bias_squared)).flatten()),
            Cell::number(Some(knob.mean_shift.value), small).with_interval(small_bounds(&knob.mean_shift)),
            Cell::number(knob.pays_above, small),
        ];
        (class.to_owned(), cells)
    };
    let rows: Vec<_> = report.knobs.iter().map(row).collect();
    format!(
        "<section id=\"knobs\"><h2>Knobs</h2>\n<p>Each knob turned by itself, at {} samples per pixel. Time to equal variance is \
         what it costs compared with more samples in the base: below 1 it buys more than it costs. A bias stays whatever the \
         samples, so that a biased knob pays above some error only.</p>\n{}</section>\n",
        report.base_samples,
        table("What each knob is worth", &columns, &rows)
    )
}

fn points(report: &TradeoffReport) -> String {
    let longest = report.points.iter().filter_map(|point| Some(point.seconds?.value)).fold(0.0, f64::max);
    let unit = Unit::of_time(longest);
    let columns = [
        ("point", ""),
        ("samples", ""),
        ("time", unit.symbol),
        ("relMSE", ""),
        ("bias²", ""),
        ("variance", ""),
        ("mean error", "of the mean"),
        ("efficiency", "1/(relMSE·s)"),
        ("renders", ""),
    ]
    .map(|(name, unit)| (name.to_owned(), unit));
    let row = |point: &PointReport| {
        let small_cell = |estimate: Option<Estimate>| {
            let interval = estimate.map(|e| bounds(&e, small));
            Cell::number(estimate.map(|e| e.value), small).with_interval(interval)
        };
        let part = |of: fn(&Decomposition) -> Estimate| small_cell(point.rel_mse.as_ref().map(of));
        let name =
            point.failed.as_ref().map_or_else(|| point.label.clone(), |reason| format!("{}: {reason}", point.label));
        let cells = vec![
            Cell::text(&name),
            Cell::number(Some(f64::from(point.samples)), |v| v.to_string()),
            Cell::number(point.seconds.map(|s| s.value), |v| unit.number(v))
                .with_interval(point.seconds.map(|s| bounds(&s, |v| unit.number(v)))),
            part(|error| error.total),
            part(|error| error.bias_squared),
            part(|error| error.variance),
            small_cell(point.mean_error),
            Cell::number(point.efficiency.map(|e| e.value), small),
            Cell::number(Some(point.runs.len() as f64), |v| v.to_string()),
        ];
        let class = if point.failed.is_some() {
            "failed"
        } else if point.on_front {
            "baseline"
        } else {
            ""
        };
        (class.to_owned(), cells)
    };
    let rows: Vec<_> = report.points.iter().map(row).collect();
    format!(
        "<section id=\"points\"><h2>Points</h2>\n<p>All that was rendered; the front stands out. Bias² is estimated \
         without bias, and may come out below 0 where there is hardly any.</p>\n{}</section>\n",
        table("All points of the sweep", &columns, &rows)
    )
}

/// The reference next to each image of the front.
fn images(report: &TradeoffReport, page: &mut PageImages<'_>) -> String {
    let Some(reference) = report.reference_image() else { return String::new() };
    let mut options = String::new();
    for point in report.front.iter().map(|i| &report.points[*i]) {
        let (Some(image), Some(time)) = (&point.image, point.seconds) else { continue };
        if compare_images(image, reference).is_err() {
            continue;
        }
        let (left, right) = (page.add_image(reference), page.add_image(image));
        let (heat, low, high) = page.add_difference(image, reference);
        let error =
            point.rel_mse.map_or_else(String::new, |error| format!(", relMSE {}", small_interval(&error.total)));
        let note = format!(
            "{}{error}; raywave render SCENE -o FILE {}. Heat map: relative squared error, {} (black) to {} (yellow)",
            seconds(time.value),
            point.flags,
            power_of_ten(low as i32),
            power_of_ten(high as i32)
        );
        options += &format!(
            "<option data-left=\"{left}\" data-right=\"{right}\" data-heat=\"{heat}\" data-base=\"reference\" \
             data-note=\"{}\">{}</option>\n",
            escape(&note),
            escape(&point.full_label())
        );
    }
    let size = (report.facts.width_pixels, report.facts.height_pixels);
    let figure = image_figure("One render of each point of the front", &options, size);
    if figure.is_empty() {
        figure
    } else {
        format!("<section id=\"images\"><h2>Images along the front</h2>\n<article>{figure}</article></section>\n")
    }
}

/// Entries of the provenance that only a sweep has.
fn entries(report: &TradeoffReport) -> Vec<(String, String)> {
    let facts = &report.facts;
    let method = format!(
        "Every point is rendered once a round, in a random order (order seed {}), by the random numbers of the round's \
         number; all points share them. Squared bias is the mean product of the errors of two different renders, variance \
         what the mean square has beyond it; the reference's own variance is taken off. Intervals of {:.0} %: of \
         median times and their ratios between order statistics, of errors by {} resamples of the renders.",
        report.seed,
        100.0 * report.confidence,
        report.bootstrap_resamples
    );
    let mut entries = vec![
        ("image".to_owned(), format!("{} × {} pixels", facts.width_pixels, facts.height_pixels)),
        ("reference".to_owned(), reference_text(report)),
        ("method".to_owned(), method),
        ("scene hash".to_owned(), facts.scene_hash.clone()),
    ];
    entries.extend(report.base_settings.iter().map(|(key, value)| (key.clone(), plain(value))));
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks(0.5, 300.0), [1.0, 10.0, 100.0]);
        assert_eq!(ticks(0.9, 6.0), [1.0, 2.0, 5.0]);
    }
}
