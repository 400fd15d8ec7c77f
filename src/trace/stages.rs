//! Stages of the host: what the thread that drives the work did, from when to when.

use std::sync::{Arc, Mutex};
use std::time::Instant;

/// A stage that has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// What was done.
    pub name: &'static str,
    /// When it began.
    pub start: Instant,
    /// When it ended.
    pub end: Instant,
}

/// A log of stages; by default it keeps nothing, at no cost. Clones share one log.
#[derive(Debug, Clone, Default)]
pub struct Stages(Option<Arc<Mutex<Noted>>>);

#[derive(Debug, Default)]
struct Noted {
    stages: Vec<Stage>,
    under_way: bool,
}

/// A stage under way, which ends when this is dropped.
#[must_use = "the stage ends when this is dropped"]
#[derive(Debug)]
pub struct StageGuard(Option<(Arc<Mutex<Noted>>, &'static str, Instant)>);

impl Stages {
    /// A log that keeps them.
    pub fn kept() -> Self {
        Self(Some(Arc::default()))
    }

    /// Whether they are kept.
    pub fn are_kept(&self) -> bool {
        self.0.is_some()
    }

    /// Begins a stage. Stages do not nest: one that begins within another is a part of that one and is not noted, as
    /// waiting for a copy is a part of the upload.
    pub fn begin(&self, name: &'static str) -> StageGuard {
        StageGuard(self.0.as_ref().and_then(|noted| {
            let mut inside = noted.lock().ok()?;
            let begins = !std::mem::replace(&mut inside.under_way, true);
            begins.then(|| (Arc::clone(noted), name, Instant::now()))
        }))
    }

    /// Those that have ended, in order.
    pub fn ended(&self) -> Vec<Stage> {
        self.0.as_ref().and_then(|noted| Some(noted.lock().ok()?.stages.clone())).unwrap_or_default()
    }
}

impl Drop for StageGuard {
    fn drop(&mut self) {
        let Some((noted, name, start)) = self.0.take() else { return };
        if let Ok(mut noted) = noted.lock() {
            noted.under_way = false;
            noted.stages.push(Stage { name, start, end: Instant::now() });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_follow_each_other() {
        let stages = Stages::kept();
        let elsewhere = stages.clone();
        for name in ["load", "build"] {
            let _stage = stages.begin(name);
            drop(elsewhere.begin("wait"));
            drop(elsewhere.begin("wait"));
        }
        drop(elsewhere.begin("write"));
        let ended = stages.ended();
        assert_eq!(ended.iter().map(|stage| stage.name).collect::<Vec<_>>(), ["load", "build", "write"]);
        assert!(ended.windows(2).all(|pair| pair[0].end <= pair[1].start), "{ended:?}");
        assert!(ended.iter().all(|stage| stage.start <= stage.end), "{ended:?}");
    }

    #[test]
    fn nothing_is_kept_unless_it_is_asked_for() {
        let stages = Stages::default();
        drop(stages.begin("load"));
        assert!(!stages.are_kept() && stages.ended().is_empty());
    }
}
