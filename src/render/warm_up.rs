//! Warming up: work is repeated until the device's clock is steady, before anything is timed.
//!
//! A device that has been idle runs slower than one that is busy, a graphics card by several times, and takes a while
//! to speed up. Nothing here knows what the work is or by which clock it is timed.

use std::time::Duration;

/// How a device is warmed up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarmUp {
    /// Two windows in succession are steady when their speeds are no further apart than this share.
    pub agreement: f64,
    /// Seconds of a window, at least.
    pub window_seconds: f64,
    /// Seconds after which it is given up, steady or not.
    pub most_seconds: f64,
}

/// Rest after which a device of hardware may be slower than before.
const REST: Duration = Duration::from_millis(20);

/// What came of a warm-up.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct Warmth {
    /// Seconds of work.
    pub seconds: f64,
    /// Whether two windows in succession agreed before the time was up; `None` where there was time for only one.
    pub steady: Option<bool>,
    /// How far apart the speeds of the last two windows were, as a share; `None` where there was only one.
    pub last_apart: Option<f64>,
}

impl Warmth {
    /// Adds a warm-up that came after.
    pub fn add(&mut self, next: &Self) {
        self.seconds += next.seconds;
        self.steady = match (self.steady, next.steady) {
            (Some(a), Some(b)) => Some(a && b),
            (a, b) => a.or(b),
        };
        self.last_apart = match (self.last_apart, next.last_apart) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
    }
}

impl WarmUp {
    /// How a device is warmed up: one of hardware for up to 3 s. The clock of a software device is the processor's,
    /// which the host's own work keeps up, so that half a second will do.
    pub fn of(software: bool) -> Self {
        Self { agreement: 0.01, window_seconds: 0.02, most_seconds: if software { 0.5 } else { 3.0 } }
    }

    /// Whether a device is to be warmed up that has had no work for so long, or has not been warmed up at all.
    pub fn is_due(software: bool, rest: Option<Duration>) -> bool {
        rest.is_none_or(|rest| !software && rest > REST)
    }

    /// Works until the device is steady. `work` gets the seconds that it should take, about, and returns those that it
    /// took and how many units of work it did.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn run<E>(&self, mut work: impl FnMut(f64) -> Result<(f64, f64), E>) -> Result<Warmth, E> {
        let mut warmth = Warmth::default();
        let mut before: Option<f64> = None;
        while warmth.seconds < self.most_seconds {
            let (mut seconds, mut units) = (0.0, 0.0);
            // Without a clock no window would end.
            let mut turns = 0;
            while seconds < self.window_seconds && turns < MOST_TURNS {
                let (more_seconds, more_units) = work(self.window_seconds - seconds)?;
                (seconds, units) = (seconds + more_seconds, units + more_units);
                turns += 1;
            }
            warmth.seconds += seconds;
            let speed = units / seconds;
            warmth.last_apart = before.map(|before| (speed / before - 1.0).abs());
            warmth.steady = warmth.last_apart.map(|apart| apart <= self.agreement);
            if warmth.steady == Some(true) || seconds <= 0.0 {
                break;
            }
            before = Some(speed);
        }
        Ok(warmth)
    }
}

/// Turns of work in a window, at most.
const MOST_TURNS: u32 = 10_000;

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    const WARM_UP: WarmUp = WarmUp { agreement: 0.01, window_seconds: 0.1, most_seconds: 3.0 };

    /// Warms up a device that does `units` of work in 10 ms, a function of the time that it has worked.
    fn warm_up(units: impl Fn(f64) -> f64) -> (Warmth, f64) {
        let mut clock = 0.0;
        let warmth = WARM_UP.run(|_| {
            let done = units(clock);
            clock += 0.01;
            Ok::<_, Infallible>((0.01, done))
        });
        let Ok(warmth) = warmth;
        (warmth, clock)
    }

    #[test]
    fn a_steady_device_takes_two_windows() {
        let (warmth, clock) = warm_up(|_| 5.0);
        assert!(warmth.steady == Some(true) && (0.2..0.23).contains(&clock), "{warmth:?} after {clock} s");
        assert!((warmth.seconds - clock).abs() < 1e-9);
        assert!(warmth.last_apart.is_some_and(|apart| apart < 1e-9));
    }

    #[test]
    fn a_device_that_speeds_up_is_waited_for() {
        // As a card that wakes: from a sixth of its speed to all of it within 0.8 s.
        let speed = |clock: f64| (1.0_f64 / 6.0 + clock).min(1.0);
        let (warmth, clock) = warm_up(speed);
        assert!(warmth.steady == Some(true) && clock > 0.8 && clock < 1.3, "{warmth:?} after {clock} s");
        assert_eq!(speed(clock), 1.0);
    }

    #[test]
    fn one_that_never_settles_is_reported() {
        // A tenth faster in each window than in the one before.
        let (warmth, clock) = warm_up(f64::exp);
        assert!(warmth.steady == Some(false) && warmth.last_apart.is_some_and(|apart| apart > 0.01), "{warmth:?}");
        assert!((3.0..3.2).contains(&clock), "given up after {clock} s");
    }

    #[test]
    fn work_longer_than_all_of_it_is_done_once() {
        let mut turns = 0;
        let Ok(warmth) = WARM_UP.run(|_| {
            turns += 1;
            Ok::<_, Infallible>((5.0, 1.0))
        });
        assert_eq!((turns, warmth.steady, warmth.last_apart), (1, None, None));
    }

    #[test]
    fn only_hardware_falls_asleep() {
        let (short, long) = (Some(Duration::from_millis(5)), Some(Duration::from_secs(1)));
        for (software, rest, due) in
            [(false, None, true), (true, None, true), (false, short, false), (false, long, true), (true, long, false)]
        {
            assert_eq!(WarmUp::is_due(software, rest), due, "{software} {rest:?}");
        }
    }

    #[test]
    fn a_clock_that_stands_still_ends_it() {
        let Ok(warmth) = WARM_UP.run(|_| Ok::<_, Infallible>((0.0, 1.0)));
        assert_eq!(warmth.steady, None);
    }
}
