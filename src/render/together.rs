//! One image by several devices: each takes rows of a block as soon as it is free, and the film has the bits of a render by
//! one of them.

use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use super::error::RenderError;
use super::kept::Kept;
use super::plan::Tile;
use super::session::{Ending, Progress, Session};
use super::statistics::Statistics;
use crate::film::Missing;
use crate::layout::FilmPixel;

/// Time that a device should take for what it is given: the longer, the less time goes into what is between; the shorter,
/// the sooner its samples are safe.
const UNIT_SECONDS: f64 = 1.0;
/// The share of the image's rows that a device gets first, when its speed is not known.
const FIRST_SHARE: u32 = 64;
/// Time between two looks of the host at what the devices have done.
const EVERY: Duration = Duration::from_millis(50);

/// Rows of a block that one device renders, and what there was of them.
struct Unit {
    tile: Tile,
    missing: Missing,
    begun: Vec<FilmPixel>,
}

/// What the devices share.
struct Pool {
    kept: Kept,
    /// Blocks that are still to be given away, as samples by number; of the first, the rows from `row` on.
    blocks: Vec<Range<u32>>,
    row: u32,
    /// Samples a second by device, once they are known.
    speeds: Vec<Option<f64>>,
}

impl Pool {
    /// The next rows for a device that holds at most so many of them; `None` where all are given away.
    fn next(&mut self, device: usize, most_rows: u32) -> Option<Unit> {
        loop {
            let block = self.blocks.first()?.clone();
            let (width, height) = (self.kept.film_mut().width, self.kept.film_mut().height);
            let row_samples = f64::from(width) * f64::from(block.end - block.start);
            let rows = match self.speeds[device] {
                Some(speed) => {
                    // Half of its share of what is left: so all end at about the same time.
                    let left = row_samples * f64::from(height) * self.blocks.len() as f64;
                    let share = speed / self.speeds.iter().flatten().sum::<f64>();
                    (speed * UNIT_SECONDS).min(0.5 * share * left) / row_samples
                }
                None => f64::from(height / FIRST_SHARE),
            };
            let most = (rows as u32).clamp(1, most_rows);
            let Some(rows) = self.kept.film_mut().rows_from(self.row, most) else {
                self.blocks.remove(0);
                self.row = 0;
                continue;
            };
            self.row = rows.end;
            let film = self.kept.film_mut();
            if let Some(missing) = film.missing(rows.start, &block) {
                let tile = Tile { first_row: rows.start, rows: rows.end - rows.start };
                let begun = film.begun(rows.start, missing.block).to_vec();
                return Some(Unit { tile, missing, begun });
            }
        }
    }
}

/// What a device has to tell.
enum News {
    /// So many samples more.
    Taken(u64),
    /// It has ended.
    Ended(usize, Box<Result<Statistics, RenderError>>),
}

/// Renders the samples that the film in `kept` lacks by all sessions, which are of the same scene and settings on different
/// devices. `progress` is that of [`Session::go_on`]. Returns what each session cost, or why it failed; what a failed one
/// had begun is left for the others, or is lacking in the end.
///
/// # Panics
/// When there is no session.
pub fn render_together(
    sessions: Vec<Session>,
    kept: &mut Kept,
    mut progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
) -> (Vec<Result<Statistics, RenderError>>, Statistics) {
    let first = sessions.first().expect("there is a device");
    let nothing = kept.statistics().cloned().unwrap_or_else(|| first.nothing());
    let wanted = first.wanted().to_vec();
    let samples = wanted.iter().map(|samples| u64::from(samples.end - samples.start)).sum::<u64>();
    let film = kept.begin(|| first.empty_film());
    let total = u64::from(film.width) * u64::from(film.height) * samples;
    let before = wanted.iter().map(|samples| film.samples_of(samples)).sum::<u64>();
    let size = film.block_samples;
    let blocks = wanted.iter().flat_map(|samples| {
        let samples = samples.clone();
        samples.clone().step_by(size as usize).map(move |first| first..samples.end.min(first + size))
    });
    let start = Instant::now();
    let pool =
        Pool { blocks: blocks.collect(), row: 0, speeds: vec![None; sessions.len()], kept: std::mem::take(kept) };
    let pool = Mutex::new(pool);
    let stop = AtomicBool::new(false);
    let mut ended: Vec<Option<Result<Statistics, RenderError>>> = sessions.iter().map(|_| None).collect();
    let mut taken = 0;
    std::thread::scope(|scope| {
        let (news, heard) = channel();
        for (device, session) in sessions.into_iter().enumerate() {
            let news = news.clone();
            let (pool, stop) = (&pool, &stop);
            scope.spawn(move || {
                let outcome = work(session, device, pool, stop, &news);
                // The host listens until all have ended.
                let _ = news.send(News::Ended(device, Box::new(outcome)));
            });
        }
        drop(news);
        loop {
            match heard.recv_timeout(EVERY) {
                Ok(News::Taken(more)) => taken += more,
                Ok(News::Ended(device, outcome)) => ended[device] = Some(*outcome),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let mut pool = lock(&pool);
            let looks = pool.kept.is_due();
            let begun = Instant::now();
            if looks {
                let sample_count = nothing.sample_count + taken;
                let wall_time = nothing.wall_time + start.elapsed();
                let statistics = Statistics { sample_count, camera_rays: sample_count, wall_time, ..nothing.clone() };
                pool.kept.keep(statistics);
            }
            let told = Progress {
                samples_done: before + taken,
                samples_total: total,
                samples_taken: taken,
                rays: taken,
                elapsed: start.elapsed(),
                error: None,
                looked: looks.then_some(&pool.kept),
            };
            if progress(&told).is_break() {
                stop.store(true, Ordering::Relaxed);
            }
            if looks {
                (pool.kept.at, pool.kept.cost) = (Instant::now(), begun.elapsed());
            }
        }
    });
    let Pool { kept: mut all, .. } = pool.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    all.film_mut().join();
    let ended: Vec<_> = ended.into_iter().map(|outcome| outcome.expect("each has told of its end")).collect();
    let before_time = nothing.wall_time;
    let sum = ended.iter().flatten().fold(nothing, |sum, statistics| sum.beside(statistics));
    all.keep(Statistics { wall_time: before_time + start.elapsed(), ..sum.clone() });
    let told = all.statistics().cloned().unwrap_or(sum);
    *kept = all;
    (ended, told)
}

fn lock(pool: &Mutex<Pool>) -> MutexGuard<'_, Pool> {
    // A thread that panics ends the render when it is joined.
    pool.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Renders one unit after the other.
fn work(
    mut session: Session,
    device: usize,
    pool: &Mutex<Pool>,
    stop: &AtomicBool,
    news: &Sender<News>,
) -> Result<Statistics, RenderError> {
    let start = Instant::now();
    let goes_on = || !stop.load(Ordering::Relaxed);
    session.begin(goes_on)?;
    let mut taken = 0;
    while goes_on() {
        let Some(unit) = lock(pool).next(device, session.plan.tile_rows) else { break };
        let (begun, mut samples) = (Instant::now(), 0);
        let (rows, pixels) = session.render_unit(unit.tile, unit.missing, &unit.begun, |batch| {
            samples += u64::from(batch.paths());
            let _ = news.send(News::Taken(batch.paths().into()));
            goes_on()
        })?;
        taken += samples;
        let mut pool = lock(pool);
        pool.speeds[device] = Some(samples as f64 / begun.elapsed().as_secs_f64().max(1e-6));
        pool.kept.put(unit.tile, unit.missing.block, rows, pixels);
    }
    session.cost(taken, start.elapsed())
}
