//! `--trace`: stages of the host, passes of the device and queue lengths in one file that Perfetto reads.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde_json::{Map, Value, json};

use raywave::constants::COUNTED_BOUNCES;
use raywave::gpu::Alignment;
use raywave::render::{DeviceTrace, Purpose, TracedBatch};
use raywave::trace::{Stage, Trace, Track};

/// Passes of a trace, at most: some 150 bytes each in the file.
pub const MOST_PASSES: usize = 1 << 20;

/// Tracks of the device.
struct DeviceTracks {
    bounces: Track,
    passes: Track,
}

/// Writes the file. `origin` is where its time begins; there is a trace of the device for each time that it was opened.
pub fn write(
    path: &Path,
    origin: Instant,
    stages: &[Stage],
    device: &str,
    traces: &[DeviceTrace],
) -> anyhow::Result<()> {
    let trace = assemble(origin, stages, device, traces);
    raywave::whole_file::write(path, |file| trace.write(file))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

fn assemble(origin: Instant, stages: &[Stage], device: &str, traces: &[DeviceTrace]) -> Trace {
    let mut trace = Trace::new(origin);
    trace.note("raywave_version", raywave::VERSION);
    let host = trace.track("host", "stages");
    for Stage { name, start, end } in stages {
        trace.span(host, "stage", *name, [*start, *end], Map::new());
    }
    let process = format!("device: {device}");
    let tracks = DeviceTracks { bounces: trace.track(&process, "bounces"), passes: trace.track(&process, "passes") };
    for (number, batch) in traces.iter().flat_map(|trace| &trace.batches).enumerate() {
        add_batch(&mut trace, &tracks, number, batch);
    }
    trace.note("clocks", traces.iter().map(|trace| clocks(trace.alignment)).collect::<Vec<_>>());
    trace.note("dropped_passes", traces.iter().map(DeviceTrace::dropped_passes).sum::<usize>());
    trace.note("bounces_counted_apart", COUNTED_BOUNCES - 1);
    trace
}

/// How a device's clock was brought to the host's.
fn clocks(alignment: Alignment) -> Value {
    match alignment {
        Alignment::Calibrated { max_deviation } => {
            json!({ "alignment": "calibrated", "max_deviation_us": max_deviation.as_nanos() as f64 / 1e3 })
        }
        Alignment::BySubmission => json!({ "alignment": "by submission" }),
        Alignment::NoClock => json!({ "alignment": "none: the device has no clock" }),
    }
}

fn add_batch(trace: &mut Trace, tracks: &DeviceTracks, number: usize, batch: &TracedBatch) {
    let (purpose, queues) = match batch.purpose {
        Purpose::Sampling => ("sampling", "queues of samplings"),
        Purpose::Render => ("render", "queues"),
    };
    let arguments = |bounce: Option<u32>| {
        let mut arguments = Map::new();
        arguments.extend(bounce.map(|bounce| ("bounce".to_owned(), bounce.into())));
        arguments.insert("batch".to_owned(), number.into());
        arguments.insert("purpose".to_owned(), purpose.into());
        arguments
    };
    let passes: Vec<_> = batch.submissions.iter().flat_map(|submission| &submission.passes).collect();
    for pass in &passes {
        trace.span(tracks.passes, "pass", pass.kernel, [pass.start, pass.end], arguments(pass.of_bounce));
    }
    for bounce in passes.chunk_by(|a, b| a.of_bounce == b.of_bounce) {
        let (first, last) = (bounce[0], bounce[bounce.len() - 1]);
        let Some(number) = first.of_bounce else { continue };
        trace.span(
            tracks.bounces,
            "bounce",
            format!("bounce {number}"),
            [first.start, last.end],
            arguments(first.of_bounce),
        );
        if let Some(queue) = batch.queues.get(number as usize) {
            let lengths = vec![("rays", queue.rays), ("shadow rays", queue.shadow_rays)];
            trace.counters(tracks.passes, queues, first.start, lengths);
        }
    }
    if let (Some(last), false) = (passes.last(), batch.queues.is_empty()) {
        trace.counters(tracks.passes, queues, last.end, vec![("rays", 0), ("shadow rays", 0)]);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use raywave::gpu::{TracedPass, TracedSubmission};
    use raywave::render::QueueLengths;

    #[test]
    fn queues_stand_where_their_bounces_begin() {
        let origin = Instant::now();
        let at = |microseconds| origin + Duration::from_micros(microseconds);
        let pass = |kernel, of_bounce, start, end| TracedPass { kernel, of_bounce, start: at(start), end: at(end) };
        let passes = vec![
            pass("generate", None, 10, 20),
            pass("extend", Some(0), 20, 40),
            pass("shade", Some(0), 40, 50),
            pass("extend", Some(1), 50, 60),
            pass("resolve", None, 60, 70),
        ];
        let submission = TracedSubmission { submitted: at(1), seen: at(80), passes, dropped: 0, counts: Vec::new() };
        let queues = vec![QueueLengths { rays: 8, shadow_rays: 3 }, QueueLengths { rays: 5, shadow_rays: 0 }];
        let batch = TracedBatch { purpose: Purpose::Render, submissions: vec![submission], queues };
        let alignment = Alignment::Calibrated { max_deviation: Duration::from_nanos(1500) };
        let stage = Stage { name: "wait", start: at(2), end: at(81) };
        let trace = assemble(origin, &[stage], "a card", &[DeviceTrace { alignment, batches: vec![batch] }]);
        let mut bytes = Vec::new();
        trace.write(&mut bytes).expect("a buffer takes everything");
        let json: Value = serde_json::from_slice(&bytes).expect("it is JSON");
        assert_eq!(json["otherData"]["clocks"], json!([{ "alignment": "calibrated", "max_deviation_us": 1.5 }]));
        assert_eq!(json["otherData"]["dropped_passes"], 0);
        let events = json["traceEvents"].as_array().expect("a list");
        let counters: Vec<_> = events.iter().filter(|e| e["ph"] == "C").map(|e| (&e["ts"], &e["args"])).collect();
        let counted =
            |ts: f64, rays: u64, shadow_rays: u64| (json!(ts), json!({ "rays": rays, "shadow rays": shadow_rays }));
        let expected = [counted(20.0, 8, 3), counted(50.0, 5, 0), counted(70.0, 0, 0)];
        assert_eq!(counters, expected.each_ref().map(|(ts, args)| (ts, args)));
        let spans: Vec<_> = events
            .iter()
            .filter(|e| e["ph"] == "X")
            .map(|e| {
                (
                    e["cat"].as_str().unwrap(),
                    e["name"].as_str().unwrap(),
                    e["ts"].as_f64().unwrap(),
                    e["dur"].as_f64().unwrap(),
                )
            })
            .collect();
        assert_eq!(
            spans,
            [
                ("stage", "wait", 2.0, 79.0),
                ("pass", "generate", 10.0, 10.0),
                ("bounce", "bounce 0", 20.0, 30.0),
                ("pass", "extend", 20.0, 20.0),
                ("pass", "shade", 40.0, 10.0),
                ("pass", "extend", 50.0, 10.0),
                ("bounce", "bounce 1", 50.0, 10.0),
                ("pass", "resolve", 60.0, 10.0),
            ]
        );
    }
}
