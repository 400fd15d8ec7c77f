//! Traces: that they have every pass of the schedule where the device ran it, and as many rays as were counted; and that
//! neither they nor labels change a pixel.

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use crate::common::project::program;
use crate::common::{assert_silent, device, floor, own_scene, prepare, tries};
use raywave::gpu::{Alignment, Device, Instance, Tools, TracedPass};
use raywave::render::{DeviceTrace, Purpose, Session, Statistics};
use raywave::scene::Scene;
use raywave::settings::{Scheduler, Settings, ShadowRays, Sort};
use raywave::trace::Stages;
use serde_json::Value;

/// Bounces that go to the device at once.
const AT_ONCE: usize = 32;

/// A device that is opened for a trace.
fn traced_device() -> Device {
    let validation = std::env::var_os("RAYWAVE_NO_VALIDATION").is_none();
    let tools = Tools { validation, labels: true, stages: Stages::kept() };
    let instance = Arc::new(Instance::with_tools(tools).expect("GPU tests need Vulkan and its validation layer"));
    let wanted = std::env::var("RAYWAVE_DEVICE").ok();
    let description = instance.choose(wanted.as_deref()).expect("GPU tests need a Vulkan device");
    Device::open(&instance, description).expect("the device opens")
}

/// Renders, with a trace of so many passes if one is wanted: digest of the pixels, cost and trace.
fn render(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    most_passes: Option<usize>,
) -> (String, Statistics, Option<DeviceTrace>) {
    let prepared = prepare(device, scene, settings);
    let mut session = Session::new(device, &prepared, settings).expect("the session starts");
    if let Some(most) = most_passes {
        session.keep_trace(most).expect("it can be kept");
    }
    let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
    let trace = session.take_trace();
    drop(session);
    assert_silent(device);
    (outcome.film.mean().digest(), outcome.statistics, trace)
}

fn settings(scene: &Scene, scheduler: Scheduler) -> Settings {
    Settings {
        width: 24,
        height: 16,
        samples: 8,
        max_bounces: Some(3),
        scheduler: Some(scheduler),
        in_flight: Some(1024),
        ..scene.settings
    }
}

fn passes(trace: &DeviceTrace) -> Vec<TracedPass> {
    let submissions = trace.batches.iter().flat_map(|batch| &batch.submissions);
    submissions.flat_map(|submission| submission.passes.clone()).collect()
}

/// Fails where passes overlap, or were not between the submission and its end as the host saw them.
fn assert_in_time(trace: &DeviceTrace) {
    let all = passes(trace);
    assert!(all.iter().all(|pass| pass.start <= pass.end), "a pass ends before it begins");
    assert!(all.windows(2).all(|pair| pair[0].end <= pair[1].start), "passes overlap");
    let submissions: Vec<_> = trace.batches.iter().flat_map(|batch| &batch.submissions).collect();
    // Where the first submission alone aligns the clocks, all is early by what it took to begin on the device.
    let allowed = match trace.alignment {
        Alignment::Calibrated { max_deviation } => {
            assert!(max_deviation > Duration::ZERO && max_deviation < Duration::from_millis(10), "{max_deviation:?}");
            max_deviation
        }
        Alignment::BySubmission => {
            let first = submissions[0];
            first.seen - first.passes.last().expect("it has passes").end
        }
        Alignment::NoClock => return,
    };
    for submission in submissions {
        for pass in &submission.passes {
            assert!(pass.start + allowed >= submission.submitted, "{pass:?} begins before {:?}", submission.submitted);
            assert!(pass.end <= submission.seen + allowed, "{pass:?} ends after {:?}", submission.seen);
        }
    }
}

/// Kernels of a batch with the bounces that they are a part of.
fn schedule(settings: &Settings, bounces: u32) -> Vec<(&'static str, Option<u32>)> {
    let at = |bounce| {
        let kernels: &[&str] = match (settings.scheduler, settings.sort, settings.shadow_rays) {
            (Some(Scheduler::Wavefront), Sort::None, _) => &["extend", "shade", "prepare_dispatch", "connect"],
            (Some(Scheduler::Wavefront), ..) => {
                &["extend", "count_bins", "place_bins", "sort_rays", "shade", "prepare_dispatch", "connect"]
            }
            (_, _, ShadowRays::Deferred) => &["bounce", "prepare_dispatch", "connect"],
            (_, _, ShadowRays::AtOnce) => &["bounce", "prepare_dispatch"],
        };
        kernels.iter().map(move |kernel| (*kernel, Some(bounce)))
    };
    let begin = [("generate", None), ("prepare_dispatch", None)];
    // The vertex after the last bounce still finds emission.
    begin.into_iter().chain((0..=bounces).flat_map(at)).chain([("resolve", None)]).collect()
}

#[test]
fn samplings_follow_their_paths_to_the_end() {
    let device = traced_device();
    let scene = floor("newmtl floor\nKd 0.5 0.5 0.5\n");
    // So many paths that the pace is sampled.
    let settings =
        Settings { width: 192, height: 192, samples: 4, in_flight: None, ..settings(&scene, Scheduler::Bounce) };
    let (digest, _, trace) = render(&device, &scene, &settings, Some(usize::MAX));
    let batches = trace.expect("a trace was kept").batches;
    let mut samplings = batches.iter().filter(|batch| batch.purpose == Purpose::Sampling).peekable();
    assert!(samplings.peek().is_some(), "the pace is sampled");
    assert!(samplings.all(|batch| batch.queues.len() == 2), "paths leave the floor for the sky");
    // A session samples once.
    let prepared = prepare(&device, &scene, &settings);
    let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
    for _ in 0..2 {
        let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
        assert_eq!(outcome.film.mean().digest(), digest, "samplings leave no trace in the film");
    }
}

#[test]
fn a_trace_has_every_pass_and_every_ray() {
    let device = traced_device();
    let scene = own_scene("cornell-glass");
    let sorted = |settings| Settings { sort: Sort::Material, ..settings };
    let at_once = |settings| Settings { shadow_rays: ShadowRays::AtOnce, ..settings };
    let [wavefront, bounce] = [Scheduler::Wavefront, Scheduler::Bounce].map(|kind| settings(&scene, kind));
    // More bounces than go to the device at once, so that batches have several submissions.
    let long = Settings { max_bounces: Some(40), roulette: 0.1, ..bounce };
    for (case, settings) in [wavefront, long, sorted(wavefront), bounce, at_once(bounce)].into_iter().enumerate() {
        if !tries(&device, case, 4) {
            continue;
        }
        let (digest, statistics, trace) = render(&device, &scene, &settings, Some(usize::MAX));
        let trace = trace.expect("a trace was kept");
        let (plain, ..) = render(&device, &scene, &settings, None);
        assert_eq!(digest, plain, "a trace changes no pixel");

        let bounces = settings.max_bounces.expect("they are bounded");
        let submissions = 1 + bounces as usize / AT_ONCE;
        for batch in &trace.batches {
            assert_eq!(batch.purpose, Purpose::Render, "so small a render is not sampled");
            assert_eq!(batch.submissions.len(), submissions, "{settings:?}");
            let ran = batch.submissions.iter().flat_map(|submission| &submission.passes);
            let ran: Vec<_> = ran.map(|pass| (pass.kernel, pass.of_bounce)).collect();
            // After so many bounces the host looks whether a path is left.
            let last = if batch.queues.len() > AT_ONCE { bounces } else { bounces.min(AT_ONCE as u32 - 1) };
            assert_eq!(ran, schedule(&settings, last), "{settings:?}");
        }
        assert!(trace.batches.len() > 2, "several batches are tried");
        assert_eq!(trace.dropped_passes(), 0);
        assert_in_time(&trace);
        for (kernel, time) in statistics.kernels() {
            let ran: Vec<_> = passes(&trace).into_iter().filter(|pass| pass.kernel == kernel).collect();
            assert_eq!(ran.len() as u64, time.launches, "{kernel}");
            let seconds: f64 = ran.iter().map(|pass| (pass.end - pass.start).as_secs_f64()).sum();
            // Ends are rounded to nanoseconds.
            let error = (seconds - time.seconds).abs();
            assert!(error <= 2e-9 * ran.len() as f64, "{kernel} takes {seconds} s in the trace and {} s", time.seconds);
        }

        let mut queued = vec![[0; 2]; statistics.ray_counts.len()];
        for queues in trace.batches.iter().map(|batch| &batch.queues) {
            assert!(queues[0].rays > 0 && queues.windows(2).all(|pair| pair[0].rays >= pair[1].rays), "{queues:?}");
            for (sum, queue) in queued.iter_mut().zip(queues) {
                *sum = [sum[0] + queue.rays, sum[1] + queue.shadow_rays];
            }
        }
        let counted: Vec<_> = statistics.ray_counts.iter().map(|count| [count.rays(), count.shadow_rays()]).collect();
        assert_eq!(queued, counted, "rays by bounce; {settings:?}");
    }
}

#[test]
fn the_megakernel_has_passes_and_no_queues() {
    let device = traced_device();
    let scene = own_scene("cornell-box");
    let settings = settings(&scene, Scheduler::Megakernel);
    let (digest, statistics, trace) = render(&device, &scene, &settings, Some(usize::MAX));
    let trace = trace.expect("a trace was kept");
    assert_eq!(digest, render(&device, &scene, &settings, None).0, "a trace changes no pixel");
    assert_in_time(&trace);
    assert!(trace.batches.iter().all(|batch| batch.queues.is_empty()));
    for (kernel, time) in statistics.kernels() {
        let ran = passes(&trace).iter().filter(|pass| pass.kernel == kernel && pass.of_bounce.is_none()).count();
        assert_eq!(ran as u64, time.launches, "{kernel}");
    }
}

#[test]
fn what_does_not_fit_is_counted() {
    let device = traced_device();
    let scene = own_scene("cornell-box");
    let settings = settings(&scene, Scheduler::Bounce);
    let of_batch = schedule(&settings, 3).len();
    let (_, statistics, trace) = render(&device, &scene, &settings, Some(2 * of_batch + 1));
    let trace = trace.expect("a trace was kept");
    let launches: u64 = statistics.kernels().values().map(|time| time.launches).sum();
    assert_eq!(passes(&trace).len(), 2 * of_batch, "whole submissions, as long as there is room");
    assert_eq!(trace.dropped_passes() as u64, launches - 2 * of_batch as u64);
}

#[test]
fn a_session_whose_trace_is_not_kept_has_none() {
    let device = traced_device();
    let scene = own_scene("cornell-box");
    let (.., trace) = render(&device, &scene, &settings(&scene, Scheduler::Bounce), None);
    assert!(trace.is_none());
}

#[test]
fn labels_are_there_where_someone_looks() {
    let layers = "VK_INSTANCE_LAYERS";
    let layered = std::env::var_os(layers).is_some();
    let wanted = std::env::var("RAYWAVE_DEVICE").ok();
    let open = |labels| {
        let tools = Tools { labels, ..Tools::default() };
        let instance = Arc::new(Instance::with_tools(tools).expect("GPU tests need Vulkan"));
        let description = instance.choose(wanted.as_deref()).expect("GPU tests need a Vulkan device");
        Device::open(&instance, description).expect("the device opens")
    };
    assert!(open(true).has_labels(), "they were asked for");
    assert_eq!(open(false).has_labels(), layered, "nothing is paid where nobody looks");
    let validation = std::env::var_os("RAYWAVE_NO_VALIDATION").is_none();
    assert_eq!(device().has_labels(), validation || layered, "the validation layer names objects in its messages");
    if validation && !layered {
        // The same under a layer that the user has loaded, of which raywave was told nothing. Loaders listen once.
        let mut again = Command::new(std::env::current_exe().expect("this program has a path"));
        again.args(["trace::labels_are_there_where_someone_looks", "--exact"]);
        let output = again.env(layers, "VK_LAYER_KHRONOS_validation").output().expect("it starts again");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains("1 passed"), "{said}");
    }
}

/// Events of a file, with what it says of itself.
struct File {
    other: Value,
    events: Vec<Value>,
}

impl File {
    fn of_kind<'a>(&'a self, kind: &'a str) -> impl Iterator<Item = &'a Value> {
        self.events.iter().filter(move |event| event["ph"] == kind)
    }

    fn of_category<'a>(&'a self, category: &'a str) -> impl Iterator<Item = &'a Value> {
        self.of_kind("X").filter(move |event| event["cat"] == category)
    }
}

/// Nanoseconds of a time in microseconds.
fn nanoseconds(value: &Value) -> i64 {
    (value.as_f64().expect("a number") * 1e3).round() as i64
}

/// When a span begins and ends.
fn span(event: &Value) -> [i64; 2] {
    let start = nanoseconds(&event["ts"]);
    [start, start + nanoseconds(&event["dur"])]
}

/// Runs the program in a folder with those arguments; its trace and its statistics.
fn run(arguments: &[&str]) -> (File, Value) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut command = Command::new(program());
    let fixed = "render -o a.exr --width 24 --height 16 --samples 8 --in-flight 1024 --max-bounces 3 --stats a.json";
    command.current_dir(folder.path()).args(fixed.split(' ')).args(arguments).env("RAYWAVE_CACHE", "off");
    let output = command.output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read = |name: &str| -> Value {
        let text = fs::read(folder.path().join(name)).unwrap_or_else(|_| b"{}".to_vec());
        serde_json::from_slice(&text).expect("it is JSON")
    };
    let trace = read("trace.json");
    let events = trace["traceEvents"].as_array().cloned().unwrap_or_default();
    (File { other: trace["otherData"].clone(), events }, read("a.json"))
}

/// Fails where events are out of order, overlap on their track, or a stage is missing.
fn assert_sound(file: &File) {
    let rest: Vec<_> = file.events.iter().skip_while(|event| event["ph"] == "M").collect();
    assert!(rest.iter().all(|event| event["ph"] != "M"), "names stand first");
    assert!(rest.windows(2).all(|pair| nanoseconds(&pair[0]["ts"]) <= nanoseconds(&pair[1]["ts"])), "by their time");
    let mut ends: BTreeMap<[u64; 2], i64> = BTreeMap::new();
    for event in file.of_kind("X") {
        let [start, end] = span(event);
        let track = [&event["pid"], &event["tid"]].map(|id| id.as_u64().expect("a number"));
        let before = ends.insert(track, end).unwrap_or(0);
        assert!(before <= start && start <= end, "{event} begins before the one before it ends");
    }
    assert_eq!(ends.len(), 3, "stages, bounces and passes");
    let stages: Vec<_> = file.of_category("stage").map(|event| event["name"].as_str().expect("a name")).collect();
    for stage in [
        "load scene",
        "start Vulkan",
        "open device",
        "build BVH",
        "specialize kernels",
        "compile kernels",
        "upload",
        "record",
        "submit",
        "wait",
        "read film",
        "write files",
    ] {
        assert!(stages.contains(&stage), "{stage} is not among {stages:?}");
    }
}

#[test]
fn the_program_writes_what_perfetto_reads() {
    let (file, statistics) = run(&["--scheduler", "wavefront", "--trace", "trace.json", "--labels"]);
    assert_sound(&file);
    let (_, plain) = run(&["--scheduler", "wavefront"]);
    assert_eq!(statistics["pixels_blake3"], plain["pixels_blake3"], "neither trace nor labels change a pixel");

    for (kernel, time) in statistics["kernels"].as_object().expect("kernels by name") {
        let ran = file.of_category("pass").filter(|event| event["name"] == kernel.as_str()).count();
        assert_eq!(ran as u64, time["launches"].as_u64().expect("a count"), "{kernel}");
    }
    let queued = |key| -> u64 { file.of_kind("C").map(|event| event["args"][key].as_u64().expect("a count")).sum() };
    let counted = |key: &str| statistics[key].as_u64().expect("a count");
    assert_eq!(queued("rays"), counted("camera_rays") + counted("bounce_rays"));
    assert_eq!(queued("shadow rays"), counted("shadow_rays"));
    assert!(queued("shadow rays") > 0);

    let clocks = file.other["clocks"].as_array().expect("one for each time that the device was opened");
    assert_eq!(clocks.len(), 1);
    let allowed = match clocks[0]["alignment"].as_str() {
        Some("calibrated") => nanoseconds(&clocks[0]["max_deviation_us"]),
        Some("by submission") => 0,
        _ => panic!("{clocks:?}"),
    };
    let stages = |name: &'static str| file.of_category("stage").filter(move |event| event["name"] == name).map(span);
    let submitted = stages("submit").map(|[start, _]| start).min().expect("something was submitted");
    let waited = stages("wait").map(|[_, end]| end).max().expect("something was waited for");
    for pass in file.of_category("pass") {
        let [start, end] = span(pass);
        assert!(submitted - allowed <= start && end <= waited + allowed, "{pass} is not in {submitted}..{waited}");
    }
    assert_eq!(file.other["dropped_passes"], 0);
}

#[test]
fn a_trace_goes_on_where_the_device_was_lost() {
    let (file, _) = run(&["--scheduler", "bounce", "--trace", "trace.json", "--lose-device", "4"]);
    assert_sound(&file);
    assert_eq!(file.other["clocks"].as_array().map(Vec::len), Some(2), "it was opened twice");
}
