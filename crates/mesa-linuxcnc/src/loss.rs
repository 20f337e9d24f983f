//! Packets that are lost or late, as a share over some time.

use core::fmt;

/// Cycles of a window.
const WINDOW: u32 = 1_000;
/// Least number of losses in a window that counts as bad: 1 %.
const BAD: u64 = 10;
/// Bad windows in a row from which on it is reported: a single stall of the computer is no rate.
const IN_A_ROW: u32 = 2;
/// Good windows in a row after which it may be reported again.
const GOOD_AGAIN: u32 = 60;

/// Watches the share of lost packets.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Losses {
    cycles: u32,
    /// Losses up to the begin of the window.
    before: u64,
    bad: u32,
    good: u32,
    /// Losses in the bad windows so far.
    lost: u64,
    is_reported: bool,
}

/// A report: that many losses in that many cycles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LossReport {
    pub lost: u64,
    pub cycles: u32,
}

impl fmt::Display for LossReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = self.lost as f64 * 100.0 / f64::from(self.cycles.max(1));
        let Self { lost, cycles } = self;
        write!(
            f,
            "{percent:.1} % of the packets are lost or late ({lost} in {cycles} cycles)"
        )
    }
}

impl Losses {
    /// Counts a cycle; `total` is the number of losses so far. Returns a report when the share has
    /// become too large, once until it has been small for a minute.
    ///
    /// # Real time
    /// A few steps.
    pub fn cycle(&mut self, total: u64) -> Option<LossReport> {
        self.cycles += 1;
        if self.cycles < WINDOW {
            return None;
        }
        self.cycles = 0;
        let lost = total.saturating_sub(core::mem::replace(&mut self.before, total));
        if lost < BAD {
            (self.bad, self.lost) = (0, 0);
            self.good = self.good.saturating_add(1);
            self.is_reported &= self.good < GOOD_AGAIN;
            return None;
        }
        self.good = 0;
        self.bad = self.bad.saturating_add(1);
        self.lost = self.lost.saturating_add(lost);
        if self.bad < IN_A_ROW || core::mem::replace(&mut self.is_reported, true) {
            return None;
        }
        Some(LossReport {
            lost: self.lost,
            cycles: self.bad.saturating_mul(WINDOW),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reports of so many cycles, of which one in `every` loses a packet.
    fn reports(losses: &mut Losses, total: &mut u64, cycles: u32, every: u32) -> Vec<LossReport> {
        let cycles = (1..=cycles).filter_map(|cycle| {
            *total += u64::from(cycle % every == 0);
            losses.cycle(*total)
        });
        cycles.collect()
    }

    #[test]
    fn loss_of_5_percent_is_reported_once_within_3_seconds() {
        for offset in [0, 1, 500, 999] {
            let (mut losses, mut total) = (Losses::default(), 0);
            assert_eq!(reports(&mut losses, &mut total, offset, u32::MAX), []);
            let found = reports(&mut losses, &mut total, 3_000, 20);
            let [report] = found[..] else {
                panic!("{found:?}");
            };
            assert_eq!(report.cycles, 2_000);
            assert!((50..=100).contains(&report.lost), "{report:?}");
            assert_eq!(reports(&mut losses, &mut total, 60_000, 20), []);
        }
    }

    #[test]
    fn stall_or_a_packet_in_a_hundred_seconds_is_not_reported() {
        let (mut losses, mut total) = (Losses::default(), 0);
        for _ in 0..100 {
            // 50 ms in which nothing comes.
            assert_eq!(reports(&mut losses, &mut total, 50, 1), []);
            assert_eq!(reports(&mut losses, &mut total, 100_000, 1_000), []);
        }
    }

    #[test]
    fn packet_loss_is_reported_again_after_a_good_minute() {
        let (mut losses, mut total) = (Losses::default(), 0);
        for _ in 0..3 {
            assert_eq!(reports(&mut losses, &mut total, 5_000, 20).len(), 1);
            assert_eq!(reports(&mut losses, &mut total, 30_000, u32::MAX), []);
            assert_eq!(reports(&mut losses, &mut total, 5_000, 20), []);
            assert_eq!(reports(&mut losses, &mut total, 61_000, u32::MAX), []);
        }
    }
}
