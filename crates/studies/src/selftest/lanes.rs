//! Subgroups and atomics, which appending to queues relies on.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};

use super::bench::{Bench, kernels, launch};
use super::{Check, Faults, Finding, Verdict};
use crate::oracle::pcg4d;
use raywave::layout::Batch;
use raywave::render::RenderError;

const SPOILS_QUEUES: &str = "queues lose paths or hold some twice: images are wrong";

pub const CHECKS: &[Check] = &[
    Check {
        name: "ballots",
        checked: "ballot, elect, broadcast, votes and sums of bits, of lanes that went different ways",
        spoils: SPOILS_QUEUES,
        run: ballots,
    },
    Check {
        name: "append",
        checked: "each place of a list is given once, to lanes that left a loop at different turns",
        spoils: SPOILS_QUEUES,
        run: append,
    },
    Check {
        name: "atomics",
        checked: "add, max and or of few words by all invocations",
        spoils: SPOILS_QUEUES,
        run: atomics,
    },
];

/// Words as `words_of` computes them.
fn words_of(index: u32, purpose: u32) -> [u32; 4] {
    pcg4d([index, purpose, 0, 0])
}

/// `wander` of `wander.glsl`.
fn wander(index: u32, purpose: u32) -> u32 {
    let mut word = words_of(index, purpose)[0];
    for turn in 0..64 {
        word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        if word >> 28 == 0 {
            return word ^ turn;
        }
        word ^= word >> 15;
    }
    word
}

/// Answers of the kernel `ballots` for a lane at one point of its code.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Voice {
    mask: [u32; 4],
    subgroup: u32,
    lane: u32,
    first: u32,
    elected: u32,
    before: u32,
    any: u32,
    all: u32,
    joined: u32,
}

impl Voice {
    fn lanes(&self) -> u128 {
        (0..).zip(self.mask).map(|(i, word)| u128::from(word) << (32 * i)).sum()
    }
}

/// Points of the kernel where it queries lanes.
const PLACES: usize = 3;

fn ballots(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    if !bench.device.description().subgroup_ballot {
        return Ok(Finding::new(0, Verdict::Property, "the device has none; raywave appends by one atomic an entry"));
    }
    let count = 256 * bench.workgroup_size();
    let voices: Vec<Voice> =
        bench.launch(kernels::BALLOTS, PLACES * count as usize * size_of::<Voice>(), launch(count))?;
    Ok(judge_ballots(count as usize, &voices))
}

/// Most lanes of a subgroup: Vulkan's masks have no more bits.
const MOST_LANES: usize = 128;

/// Lanes that are active together must agree on which they are. Which lanes are active together is not defined and only
/// counted.
fn judge_ballots(count: usize, voices: &[Voice]) -> Finding {
    let mut faults = Faults::default();
    let mut apart = 0_u64;
    for (place, voices) in voices.chunks_exact(count).enumerate() {
        let mut subgroups: BTreeMap<u32, Vec<(&Voice, u32)>> = BTreeMap::new();
        for (voice, index) in voices.iter().zip(0..) {
            let word = wander(index, 0);
            let word = if place == 1 && word & 6 == 0 { !word } else { word };
            subgroups.entry(voice.subgroup).or_default().push((voice, word));
        }
        for (subgroup, lanes) in &subgroups {
            if lanes.len() > MOST_LANES {
                let said =
                    || format!("{} lanes at place {place} say that they are of subgroup {subgroup}", lanes.len());
                faults.see(false, said);
                continue;
            }
            let masks: Vec<u128> = lanes.iter().map(|(voice, _)| voice.lanes()).collect();
            // After the loop all lanes of a subgroup could have reconverged.
            apart += u64::from(place == 0 && masks.iter().any(|mask| *mask != masks[0]));
            for (voice, _) in lanes {
                let mask = voice.lanes();
                let together: Vec<_> = lanes.iter().filter(|(other, _)| mask >> (other.lane & 127) & 1 == 1).collect();
                let below = (1_u128 << (voice.lane & 127)) - 1;
                let joined = together.iter().fold(0, |joined, (_, word)| joined | word);
                let right = voice.lane < 128
                    && mask >> voice.lane & 1 == 1
                    && together.len() == mask.count_ones() as usize
                    && together.iter().all(|(other, _)| other.lanes() == mask)
                    && together.iter().filter(|(other, _)| other.elected == 1).count() == 1
                    && voice.first == mask.trailing_zeros()
                    && voice.before == (mask & below).count_ones()
                    && (voice.any == 1) == together.iter().any(|(_, word)| word & 1 == 1)
                    && (voice.all == 1) == together.iter().all(|(_, word)| word & 1 == 1)
                    && voice.joined == joined;
                faults.see(right, || format!("of lane {} at place {place}: {voice:x?}", voice.lane));
            }
        }
    }
    let found = match apart {
        0 => "all agree; after a loop a subgroup's lanes are together again",
        _ => "all agree; after a loop lanes of a subgroup stay apart",
    };
    faults.finding(found, Verdict::Off).with("subgroups_apart_after_a_loop", apart)
}

/// Lists that `append` fills.
const ROUNDS: u32 = 8;

fn append(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let count = 512 * bench.workgroup_size();
    let batch = Batch { sample_count: ROUNDS, ..launch(count) };
    let words: Vec<u32> = bench.launch(kernels::APPEND, (4 * ROUNDS * (count + 1)) as usize, batch)?;
    Ok(judge_append(count, &words).finding("all are", Verdict::Off))
}

fn judge_append(count: u32, words: &[u32]) -> Faults {
    let mut faults = Faults::default();
    let (counts, lists) = words.split_at(ROUNDS as usize);
    for ((round, taken), list) in (0..).zip(counts).zip(lists.chunks_exact(count as usize)) {
        let expected: Vec<u32> = (0..count).filter(|index| wander(*index, round) & 0x300 != 0).collect();
        faults.see(*taken as usize == expected.len(), || format!("{taken} are counted of {}", expected.len()));
        let (given, rest) = list.split_at(expected.len());
        let mut given = given.to_vec();
        given.sort_unstable();
        for (found, index) in given.iter().zip(&expected) {
            faults.see(*found == index + 1, || format!("the entry of invocation {index} of round {round}"));
        }
        faults.see(rest.iter().all(|word| *word == 0), || format!("places beyond the list of round {round} are taken"));
    }
    faults
}

const COUNTERS: u32 = 16;

fn atomics(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let count = 256 * bench.workgroup_size();
    let words: Vec<u32> =
        bench.launch(kernels::ATOMICS, 4 * (COUNTERS + 4 + COUNTERS * count) as usize, launch(count))?;
    Ok(judge_atomics(count, &words).finding("all are right", Verdict::Off))
}

fn judge_atomics(count: u32, words: &[u32]) -> Faults {
    let mut faults = Faults::default();
    let (results, tickets) = words.split_at(COUNTERS as usize + 4);
    let drawn: Vec<u32> = (0..count).map(|index| words_of(index, 0)[0]).collect();
    for ((counter, sum), tickets) in (0..).zip(results).zip(tickets.chunks_exact(count as usize)) {
        let right = drawn.iter().filter(|word| *word % COUNTERS == counter).count();
        faults.see(*sum as usize == right, || format!("counter {counter} holds {sum} for {right}"));
        for (ticket, times) in (0..).zip(tickets) {
            let right = u32::from(ticket < right);
            faults.see(*times == right, || format!("ticket {ticket} of counter {counter} was drawn {times} times"));
        }
    }
    let joined = drawn.iter().zip(0..).fold(0, |all, (word, index)| all | (word & 0x5555_5555 & 1 << (index & 31)));
    let largest = drawn.iter().copied().max().unwrap_or_default();
    let smallest = drawn.iter().copied().min().unwrap_or_default();
    let right = [largest, !smallest, joined];
    let found = &results[COUNTERS as usize..][..3];
    faults.see(found == right, || format!("max, min and or are {found:x?} for {right:x?}"));
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: u32 = 256;

    /// Subgroups of eight lanes whose active lanes at every point are those of `mask`.
    fn voices(mask: impl Fn(usize, u32, u32) -> u32) -> Vec<Voice> {
        let mut voices = Vec::new();
        for place in 0..PLACES {
            let word = |index: u32| {
                let word = wander(index, 0);
                if place == 1 && word & 6 == 0 { !word } else { word }
            };
            for index in 0..COUNT {
                let (subgroup, lane) = (index / 8, index % 8);
                let mask = mask(place, subgroup, lane);
                let words: Vec<u32> =
                    (0..8).filter(|lane| mask >> lane & 1 == 1).map(|lane| word(8 * subgroup + lane)).collect();
                voices.push(Voice {
                    mask: [mask, 0, 0, 0],
                    subgroup,
                    lane,
                    first: mask.trailing_zeros(),
                    elected: u32::from(mask.trailing_zeros() == lane),
                    before: (mask & ((1 << lane) - 1)).count_ones(),
                    any: u32::from(words.iter().any(|word| word & 1 == 1)),
                    all: u32::from(words.iter().all(|word| word & 1 == 1)),
                    joined: words.iter().fold(0, |all, word| all | word),
                });
            }
        }
        voices
    }

    #[test]
    fn lanes_may_part_but_must_agree() {
        let together = voices(|_, _, _| 0xff);
        let finding = judge_ballots(COUNT as usize, &together);
        assert_eq!((finding.verdict, finding.found.contains("together")), (Verdict::Ok, true), "{}", finding.found);
        let apart = voices(|_, _, lane| if lane < 3 { 0x07 } else { 0xf8 });
        let finding = judge_ballots(COUNT as usize, &apart);
        assert_eq!((finding.verdict, finding.found.contains("apart")), (Verdict::Ok, true), "{}", finding.found);

        let broken: [fn(&mut Voice); 8] = [
            |voice| voice.mask[0] ^= 0x10,
            |voice| voice.mask[1] = 1,
            |voice| voice.first += 1,
            |voice| voice.elected ^= 1,
            |voice| voice.before += 1,
            |voice| voice.any ^= 1,
            |voice| voice.all ^= 1,
            |voice| voice.joined ^= 0x100,
        ];
        for (i, spoil) in broken.into_iter().enumerate() {
            let mut voices = apart.clone();
            spoil(&mut voices[300]);
            assert_eq!(judge_ballots(COUNT as usize, &voices).verdict, Verdict::Off, "fault {i}");
        }
    }

    #[test]
    fn a_place_that_is_lost_or_given_twice_is_found() {
        let mut words = vec![0; (ROUNDS * (COUNT + 1)) as usize];
        for round in 0..ROUNDS {
            let list = (ROUNDS + round * COUNT) as usize;
            // In any order.
            for index in (0..COUNT).rev().filter(|index| wander(*index, round) & 0x300 != 0) {
                let place = words[round as usize] as usize;
                words[list + place] = index + 1;
                words[round as usize] += 1;
            }
        }
        assert_eq!(judge_append(COUNT, &words).wrong, 0);
        let spoiled = |at: usize, value: u32| {
            let mut words = words.clone();
            words[at] = value;
            judge_append(COUNT, &words).wrong
        };
        assert!(spoiled(3, words[3] - 1) > 0, "a count");
        let list = ROUNDS as usize;
        assert!(spoiled(list + 5, words[list + 6]) > 0, "one entry twice, one lost");
        assert!(spoiled(list + 5, 0) > 0, "a place that nobody took");
        assert!(spoiled(list + COUNT as usize - 1, 1) > 0, "a place beyond the list");
    }

    #[test]
    fn lost_updates_are_found() {
        let mut words = vec![0; (COUNTERS + 4 + COUNTERS * COUNT) as usize];
        for index in 0..COUNT {
            let word = words_of(index, 0)[0];
            let counter = (word % COUNTERS) as usize;
            let ticket = words[counter];
            words[counter] += 1;
            words[(COUNTERS + 4 + COUNT * (word % COUNTERS) + ticket) as usize] += 1;
            let [max, min, or] = [0, 1, 2].map(|i| COUNTERS as usize + i);
            words[max] = words[max].max(word);
            words[min] = words[min].max(!word);
            words[or] |= word & 0x5555_5555 & 1 << (index & 31);
        }
        assert_eq!(judge_atomics(COUNT, &words).wrong, 0);
        for at in [0, 7, 16, 17, 18, 20, 40, words.len() - 1] {
            let mut spoiled = words.clone();
            spoiled[at] ^= 1;
            assert_eq!(judge_atomics(COUNT, &spoiled).wrong, 1, "word {at}");
        }
    }
}
