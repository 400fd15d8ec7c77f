//! Chrome's trace format, as Perfetto and `chrome://tracing` read it ("Trace Event Format", Google 2016): spans and
//! counters on the tracks of processes, in microseconds.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

/// A row of the trace, whose spans do not overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Track {
    process: usize,
    thread: usize,
}

/// What happened when.
#[derive(Debug)]
pub struct Trace {
    origin: Instant,
    /// Names of the processes, each with those of its tracks.
    processes: Vec<(String, Vec<String>)>,
    events: Vec<Event>,
    notes: Map<String, Value>,
}

#[derive(Debug)]
struct Event {
    /// Since the origin.
    at: Duration,
    track: Track,
    name: String,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    Span { category: &'static str, duration: Duration, arguments: Map<String, Value> },
    Counters(Vec<(&'static str, u64)>),
}

impl Trace {
    /// An empty one, whose times count from `origin` on.
    pub fn new(origin: Instant) -> Self {
        Self { origin, processes: Vec::new(), events: Vec::new(), notes: Map::new() }
    }

    /// The track of that name in the process of that name, which is added if it is new.
    pub fn track(&mut self, process: &str, name: &str) -> Track {
        let place = self.processes.iter().position(|(known, _)| known == process).unwrap_or_else(|| {
            self.processes.push((process.to_owned(), Vec::new()));
            self.processes.len() - 1
        });
        let tracks = &mut self.processes[place].1;
        let thread = tracks.iter().position(|known| known == name).unwrap_or_else(|| {
            tracks.push(name.to_owned());
            tracks.len() - 1
        });
        Track { process: place, thread }
    }

    /// Adds a span from `start` to `end`. A span that began before the origin is cut there.
    pub fn span(
        &mut self,
        track: Track,
        category: &'static str,
        name: impl Into<String>,
        [start, end]: [Instant; 2],
        arguments: Map<String, Value>,
    ) {
        let at = start.saturating_duration_since(self.origin);
        let duration = end.saturating_duration_since(self.origin).saturating_sub(at);
        self.events.push(Event { at, track, name: name.into(), kind: Kind::Span { category, duration, arguments } });
    }

    /// Adds the value of a counter at a time, in the process of a track.
    pub fn counters(&mut self, track: Track, name: impl Into<String>, at: Instant, values: Vec<(&'static str, u64)>) {
        let at = at.saturating_duration_since(self.origin);
        self.events.push(Event { at, track, name: name.into(), kind: Kind::Counters(values) });
    }

    /// Adds to the description of the file.
    pub fn note(&mut self, key: &str, value: impl Into<Value>) {
        self.notes.insert(key.to_owned(), value.into());
    }

    /// Writes the file, an event a line: first the names, then all events by their time.
    ///
    /// # Errors
    /// Errors of writing.
    pub fn write(mut self, out: &mut dyn Write) -> io::Result<()> {
        // Longer spans go first, so that a span comes before those that it contains.
        let length = |event: &Event| match event.kind {
            Kind::Span { duration, .. } => duration,
            Kind::Counters(_) => Duration::ZERO,
        };
        self.events.sort_by_key(|event| (event.at, std::cmp::Reverse(length(event))));
        writeln!(out, "{{\"displayTimeUnit\":\"ms\",\"otherData\":{},\"traceEvents\":[", Value::Object(self.notes))?;
        let mut separator = "";
        for line in names(&self.processes).into_iter().chain(self.events.into_iter().map(Event::record)) {
            write!(out, "{separator}{line}")?;
            separator = ",\n";
        }
        writeln!(out, "\n]}}")
    }
}

impl Track {
    /// Numbers that Perfetto accepts: it does not take 0 for a thread.
    fn ids(self) -> [usize; 2] {
        [self.process + 1, self.thread + 1]
    }
}

impl Event {
    fn record(self) -> Value {
        let Self { at, track, name, kind } = self;
        let [pid, tid] = track.ids();
        match kind {
            Kind::Span { category, duration, arguments } => json!({
                "name": name, "cat": category, "ph": "X", "ts": microseconds(at), "dur": microseconds(duration),
                "pid": pid, "tid": tid, "args": arguments,
            }),
            Kind::Counters(values) => {
                let values: Map<_, _> = values.into_iter().map(|(key, value)| (key.to_owned(), value.into())).collect();
                json!({
                    "name": name, "ph": "C", "ts": microseconds(at), "pid": pid, "tid": tid, "args": values,
                })
            }
        }
    }
}

/// Events that name processes and tracks, and keep them in order.
fn names(processes: &[(String, Vec<String>)]) -> Vec<Value> {
    let mut events = Vec::new();
    for (process, (name, tracks)) in processes.iter().enumerate() {
        let mut tell = |kind: &str, thread: usize, args: Value| {
            let [pid, tid] = Track { process, thread }.ids();
            events.push(json!({ "name": kind, "ph": "M", "ts": 0.0, "pid": pid, "tid": tid, "args": args }));
        };
        tell("process_name", 0, json!({ "name": name }));
        tell("process_sort_index", 0, json!({ "sort_index": process }));
        for (thread, name) in tracks.iter().enumerate() {
            tell("thread_name", thread, json!({ "name": name }));
            tell("thread_sort_index", thread, json!({ "sort_index": thread }));
        }
    }
    events
}

/// To the nanosecond.
fn microseconds(time: Duration) -> f64 {
    time.as_nanos() as f64 / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(trace: Trace) -> Value {
        let mut bytes = Vec::new();
        trace.write(&mut bytes).expect("a buffer takes everything");
        serde_json::from_slice(&bytes).unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&bytes)))
    }

    #[test]
    fn an_empty_trace_is_whole() {
        let json = written(Trace::new(Instant::now()));
        assert_eq!(json, json!({ "displayTimeUnit": "ms", "otherData": {}, "traceEvents": [] }));
    }

    #[test]
    fn events_stand_by_their_time_below_the_names() {
        let origin = Instant::now();
        let at = |nanoseconds| origin + Duration::from_nanos(nanoseconds);
        let mut trace = Trace::new(origin);
        let host = trace.track("host", "stages");
        let passes = trace.track("a \"device\"", "passes");
        let bounces = trace.track("a \"device\"", "bounces");
        assert_eq!(trace.track("host", "stages"), host);
        trace.note("clocks", "calibrated");
        let arguments = |json| match json {
            Value::Object(map) => map,
            _ => Map::new(),
        };
        trace.span(passes, "pass", "extend", [at(2500), at(4001)], arguments(json!({ "bounce": 1 })));
        trace.counters(passes, "queues", at(2500), vec![("rays", 7), ("shadow rays", 0)]);
        trace.span(bounces, "bounce", "bounce 1", [at(2500), at(9000)], Map::new());
        trace.span(host, "stage", "load", [at(0), at(1)], Map::new());
        let json = written(trace);
        assert_eq!(json["otherData"], json!({ "clocks": "calibrated" }));
        let events = json["traceEvents"].as_array().expect("a list");
        let named: Vec<_> = events
            .iter()
            .filter(|event| event["ph"] == "M" && event["args"].get("name").is_some())
            .map(|event| (event["name"].as_str().unwrap(), &event["args"]["name"], &event["pid"], &event["tid"]))
            .collect();
        let name = |kind, name: &'static str, pid: u64, tid: u64| (kind, json!(name), json!(pid), json!(tid));
        let expected = [
            name("process_name", "host", 1, 1),
            name("thread_name", "stages", 1, 1),
            name("process_name", "a \"device\"", 2, 1),
            name("thread_name", "passes", 2, 1),
            name("thread_name", "bounces", 2, 2),
        ];
        assert_eq!(named, expected.each_ref().map(|(kind, name, pid, tid)| (*kind, name, pid, tid)));
        let rest: Vec<_> = events.iter().skip_while(|event| event["ph"] == "M").collect();
        assert_eq!(
            rest,
            [
                &json!({ "name": "load", "cat": "stage", "ph": "X", "ts": 0.0, "dur": 0.001, "pid": 1, "tid": 1, "args": {} }),
                &json!({ "name": "bounce 1", "cat": "bounce", "ph": "X", "ts": 2.5, "dur": 6.5, "pid": 2, "tid": 2, "args": {} }),
                &json!({ "name": "extend", "cat": "pass", "ph": "X", "ts": 2.5, "dur": 1.501, "pid": 2, "tid": 1, "args": { "bounce": 1 } }),
                &json!({ "name": "queues", "ph": "C", "ts": 2.5, "pid": 2, "tid": 1, "args": { "rays": 7, "shadow rays": 0 } }),
            ]
        );
    }

    #[test]
    fn no_time_is_negative() {
        let origin = Instant::now() + Duration::from_secs(1);
        let mut trace = Trace::new(origin);
        let track = trace.track("host", "stages");
        let [before, after] = [origin - Duration::from_micros(3), origin + Duration::from_micros(2)];
        trace.span(track, "stage", "early", [before, after], Map::new());
        trace.span(track, "stage", "turned", [after, before], Map::new());
        let json = written(trace);
        let events = json["traceEvents"].as_array().expect("a list");
        let times: Vec<_> =
            events.iter().filter(|e| e["ph"] == "X").map(|e| (e["ts"].as_f64(), e["dur"].as_f64())).collect();
        assert_eq!(times, [(Some(0.0), Some(2.0)), (Some(2.0), Some(0.0))]);
    }
}
