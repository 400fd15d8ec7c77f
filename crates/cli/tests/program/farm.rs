//! The jobs of `farm/`, by the engines that run them.
#![cfg(unix)]

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::command_line::{Folder, text};
use crate::common::not_tested::not_tested;
use crate::common::project::{program, project_file};

/// A job of the runner of Open Job Description.
struct Job {
    folder: Folder,
    samples: u32,
    block: u32,
    picture: &'static str,
}

impl Job {
    /// `None` where there is no runner.
    fn new(samples: u32, block: u32, picture: &'static str) -> Option<Self> {
        let version = Command::new("openjd").arg("--version").output();
        version.is_ok_and(|output| output.status.success()).then(|| Self {
            folder: Folder::new(),
            samples,
            block,
            picture,
        })
    }

    fn scene() -> String {
        project_file("scenes/cornell-box.toml").display().to_string()
    }

    /// The runner, of a step.
    fn runner(&self, step: &str, more: &[&str]) -> Command {
        let parameters = [
            ("Scene", Self::scene()),
            ("Output", self.folder.path("merged.exr").display().to_string()),
            ("Parts", self.parts().display().to_string()),
            ("Samples", self.samples.to_string()),
            ("BlockSamples", self.block.to_string()),
            ("LastBlock", (self.samples.div_ceil(self.block) - 1).to_string()),
            ("Flags", self.picture.to_owned()),
            ("ChunkSeconds", "1".to_owned()),
            ("SaveEvery", "0.1s".to_owned()),
            ("Raywave", program().display().to_string()),
        ];
        let mut command = Command::new("openjd");
        command.arg("run").arg(project_file("farm/openjd/render.yaml")).args(["--step", step]);
        command.args(parameters.iter().flat_map(|(name, value)| ["-p".to_owned(), format!("{name}={value}")]));
        // What a killed runner leaves goes with the folder.
        command.args(more).env("TMPDIR", self.folder.path("")).env("RAYWAVE_CACHE", "off");
        command
    }

    fn parts(&self) -> PathBuf {
        self.folder.path("parts")
    }

    /// Begins to render chunks, one after the other.
    fn worker(&self, name: &str, chunks: &[&str]) -> Worker {
        let log = self.folder.path(&format!("{name}.log"));
        let file = File::create(&log).expect("a temporary file");
        let tasks: Vec<_> = chunks.iter().map(|blocks| format!("{{\"Blocks\": \"{blocks}\"}}")).collect();
        let mut runner = self.runner("Render", &["--tasks", &format!("[{}]", tasks.join(", "))]);
        runner.stdout(file.try_clone().expect("a second handle")).stderr(file).stdin(Stdio::null());
        Worker { runner: runner.spawn().expect("it starts"), log }
    }

    /// Runs a step to its end.
    fn finish(&self, step: &str, more: &[&str]) -> String {
        let output = self.runner(step, more).output().expect("it starts");
        assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
        text(&output.stdout)
    }

    /// That the merged image is the one that one process renders.
    fn assert_whole(&self) {
        let (samples, block) = (self.samples.to_string(), self.block.to_string());
        let mut arguments =
            vec!["render", "--quiet", "-o", "whole.exr", "--samples", &samples, "--block-samples", &block];
        let scene = Self::scene();
        arguments.push(&scene);
        arguments.extend(self.picture.split(' '));
        self.folder.succeed(&arguments);
        let read = |name| fs::read(self.folder.path(name)).expect("it is there");
        assert!(read("merged.exr") == read("whole.exr"), "the merged image differs");
    }
}

/// A runner, and what it says.
struct Worker {
    runner: Child,
    log: PathBuf,
}

impl Worker {
    fn said(&self) -> String {
        fs::read_to_string(&self.log).expect("the log is text")
    }

    /// The process that renders a chunk, when the part is there or there is nothing more to wait for.
    fn await_part(&mut self, part: PathBuf) -> String {
        while !part.exists() && self.runner.try_wait().expect("it can be waited for").is_none() {
            sleep(Duration::from_millis(5));
        }
        let said = self.said();
        let process = said.split("Command started as pid: ").nth(1).expect("it has begun");
        process.lines().next().expect("a number").trim().to_owned()
    }

    /// Percent of the chunk when it began and when it ended.
    fn progress(&self) -> (f64, f64) {
        let said = self.said();
        let mut percents = said.split("openjd_progress: ").skip(1).map(|rest| {
            let number = rest.lines().next().expect("there is a number");
            number.trim().parse::<f64>().expect("it is one")
        });
        let first = percents.next().expect("it has told");
        (first, percents.last().unwrap_or(first))
    }

    fn succeed(&mut self) {
        let status = self.runner.wait().expect("it can be waited for");
        assert!(status.success(), "{}", self.said());
    }
}

/// Sends a signal to a process, or to a group where its number has a minus. It may have ended.
fn signal(name: &str, process: &str) {
    Command::new("kill").args(["-s", name, "--", process]).stderr(Stdio::null()).status().expect("kill is there");
}

#[test]
fn workers_that_are_killed_and_cancelled_cost_no_bit() {
    // Eight blocks, each of some tenths of a second in software.
    let Some(job) = Job::new(512, 64, "--width 96 --height 96 --max-bounces 5") else {
        return not_tested("farm/openjd: the runner is not installed; pip install openjd-cli");
    };
    let part = |chunk: &str| job.parts().join(format!("{chunk}.film"));
    let mut killed = job.worker("killed", &["0-3"]);
    let mut cancelled = job.worker("cancelled", &["4-5"]);
    let mut other = job.worker("other", &["6-6", "7-7"]);

    // As when the power goes: the runner first, which would notice that its task ends.
    let process = killed.await_part(part("0-3"));
    signal("KILL", &killed.runner.id().to_string());
    signal("KILL", &format!("-{process}"));
    killed.runner.wait().expect("it can be waited for");
    cancelled.await_part(part("4-5"));
    signal("TERM", &cancelled.runner.id().to_string());
    let done = cancelled.runner.wait().expect("it can be waited for").success();
    assert!(done || cancelled.said().contains("writing the samples that are done"), "{}", cancelled.said());
    other.succeed();
    let early = job.folder.run(&[
        "merge",
        "parts/0-3.film",
        "parts/4-5.film",
        "parts/6-6.film",
        "parts/7-7.film",
        "-o",
        "early.exr",
    ]);
    let broken_off = !early.status.success();
    if broken_off {
        assert!(text(&early.stderr).contains("the parts lack blocks"), "{}", text(&early.stderr));
    } else {
        not_tested("that broken-off chunks go on: this device is done with them too soon");
    }

    // The first goes on where it was; the second one's blocks are cut anew.
    let mut again = job.worker("again", &["0-3"]);
    let mut anew = job.worker("anew", &["3-5"]);
    again.succeed();
    anew.succeed();
    if broken_off {
        let (first, last) = again.progress();
        assert!(first > 0.0 && last == 100.0, "from {first} to {last} %");
    }
    job.finish("Merge", &[]);
    job.assert_whole();
}

#[test]
fn a_job_adapts_its_chunks_and_merges_them() {
    let Some(job) = Job::new(15, 1, "--width 8 --height 8") else {
        return not_tested("farm/openjd: the runner is not installed; pip install openjd-cli");
    };
    let said = job.finish("Merge", &["--run-dependencies"]);
    assert!(said.contains("Chunks run: "), "{said}");
    job.assert_whole();
}
