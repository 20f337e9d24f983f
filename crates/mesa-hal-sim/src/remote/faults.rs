//! A cable that can be faulty: wire faults on command or by chance, unplug and replug.

use crate::wire::{Burst, Nanos, RemoteEnd};

/// A fault of a burst on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WireFault {
    /// The burst does not arrive.
    Lost,
    /// A bit is inverted.
    Corrupted,
    /// Characters are missing at the end: this number.
    Short(u8),
    /// Extra characters A5 follow: this number.
    Long(u8),
    /// The burst arrives later by this time. No effect on requests, which the cable gets after
    /// their end.
    Late(Nanos),
    /// The line is low for the length of the burst instead.
    Break,
}

/// Direction of the bursts that a fault affects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Toward {
    /// Requests, from the FPGA to the remote.
    Remote,
    /// Replies, from the remote to the FPGA.
    Fpga,
}

/// Statistics of a cable in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CableCounts {
    /// Bursts that entered the cable.
    pub bursts: u64,
    /// Bursts that left it unchanged and in time.
    pub intact: u64,
    /// Bursts lost, by a fault or because the cable was unplugged.
    pub lost: u64,
    /// Bursts corrupted.
    pub corrupted: u64,
    /// Bursts shortened.
    pub short: u64,
    /// Bursts lengthened.
    pub long: u64,
    /// Bursts delayed.
    pub late: u64,
    /// Bursts turned into a break.
    pub breaks: u64,
}

#[derive(Clone, Copy, Debug)]
struct PlannedFault {
    fault: WireFault,
    /// Remaining bursts; `None`: by chance.
    left: Option<u32>,
    /// Probability in units of 2^-32.
    probability: u32,
}

const PLANS: usize = 8;

#[derive(Clone, Debug, Default)]
struct LineDirection {
    plans: [Option<PlannedFault>; PLANS],
    counts: CableCounts,
}

/// The cable between a channel and the remote at its other end.
///
/// # Real time
/// Does not allocate for a burst.
#[derive(Debug)]
pub struct Cable {
    far_end: Box<dyn RemoteEnd>,
    plugged: bool,
    low_when_unplugged: bool,
    to_remote: LineDirection,
    to_fpga: LineDirection,
    random: u64,
}

impl Cable {
    /// A cable without faults to `far_end`. The seed determines the faults by chance.
    pub fn new(far_end: Box<dyn RemoteEnd>, seed: u64) -> Self {
        Self {
            far_end,
            plugged: true,
            low_when_unplugged: false,
            to_remote: LineDirection::default(),
            to_fpga: LineDirection::default(),
            random: seed,
        }
    }

    /// Applies `fault` to the next `bursts` bursts. False if there is no room for one more plan;
    /// each direction has eight.
    pub fn inject(&mut self, toward: Toward, fault: WireFault, bursts: u32) -> bool {
        bursts == 0
            || self.plan(
                toward,
                PlannedFault {
                    fault,
                    left: Some(bursts),
                    probability: 0,
                },
            )
    }

    /// Applies `fault` to each burst with `probability` (0.0 to 1.0) from now on.
    pub fn inject_by_chance(&mut self, toward: Toward, fault: WireFault, probability: f64) -> bool {
        let probability = (probability.clamp(0.0, 1.0) * f64::from(u32::MAX)).round() as u32;
        self.plan(
            toward,
            PlannedFault {
                fault,
                left: None,
                probability,
            },
        )
    }

    fn plan(&mut self, toward: Toward, planned: PlannedFault) -> bool {
        let plans = &mut self.direction(toward).plans;
        match plans.iter_mut().find(|slot| slot.is_none()) {
            Some(slot) => {
                *slot = Some(planned);
                true
            }
            None => false,
        }
    }

    /// Ends all faults, planned and by chance.
    pub fn heal(&mut self) {
        self.to_remote.plans = [None; PLANS];
        self.to_fpga.plans = [None; PLANS];
    }

    /// Unplugs the cable: nothing arrives at either end. The remote keeps its power.
    pub fn unplug(&mut self) {
        self.plugged = false;
    }

    /// Plugs the cable in again.
    pub fn replug(&mut self) {
        self.plugged = true;
    }

    /// True if the cable is plugged in.
    pub const fn is_plugged(&self) -> bool {
        self.plugged
    }

    /// Sets the level that the FPGA sees while the cable is unplugged: low (no bias on its
    /// receiver) or idle.
    pub const fn set_low_when_unplugged(&mut self, low: bool) {
        self.low_when_unplugged = low;
    }

    /// Statistics so far.
    pub const fn counts(&self, toward: Toward) -> CableCounts {
        match toward {
            Toward::Remote => self.to_remote.counts,
            Toward::Fpga => self.to_fpga.counts,
        }
    }

    fn direction(&mut self, toward: Toward) -> &mut LineDirection {
        match toward {
            Toward::Remote => &mut self.to_remote,
            Toward::Fpga => &mut self.to_fpga,
        }
    }

    /// Carries a burst; returns the burst that arrives at the other end.
    fn carry(&mut self, toward: Toward, burst: &Burst) -> Option<Burst> {
        let plugged = self.plugged;
        let mut random = self.random;
        let direction = self.direction(toward);
        direction.counts.bursts += 1;
        if !plugged {
            direction.counts.lost += 1;
            return None;
        }
        let mut out = *burst;
        let mut faults = 0;
        for slot in &mut direction.plans {
            let Some(plan) = slot else { continue };
            let strikes = match &mut plan.left {
                Some(left) => {
                    *left = left.saturating_sub(1);
                    true
                }
                None => (next(&mut random) >> 32) < u64::from(plan.probability),
            };
            let fault = plan.fault;
            if plan.left == Some(0) {
                *slot = None;
            }
            if strikes && suffer(&mut out, fault, &mut random, &mut direction.counts) {
                faults += 1;
            }
        }
        let lost = out.is_empty();
        if lost {
            direction.counts.lost += 1;
        } else if faults == 0 {
            direction.counts.intact += 1;
        }
        self.random = random;
        (!lost).then_some(out)
    }
}

/// Damages a burst; a burst without characters is lost. True if it has changed.
fn suffer(burst: &mut Burst, fault: WireFault, random: &mut u64, counts: &mut CableCounts) -> bool {
    let before = *burst;
    match fault {
        WireFault::Lost => burst.truncate(0),
        WireFault::Corrupted => {
            let bits = (burst.len() as u64 * 8).max(1);
            let bit = next(random) % bits;
            if let Some(byte) = burst.bytes_mut().get_mut((bit / 8) as usize) {
                *byte ^= 1 << (bit % 8);
            }
            counts.corrupted += u64::from(*burst != before);
        }
        WireFault::Short(characters) => {
            burst.truncate(burst.len().saturating_sub(usize::from(characters)));
            counts.short += u64::from(*burst != before);
        }
        WireFault::Long(characters) => {
            for _ in 0..characters {
                burst.push(0xA5);
            }
            counts.long += u64::from(*burst != before);
        }
        WireFault::Late(delay) => {
            burst.start += delay;
            counts.late += u64::from(delay > 0);
        }
        WireFault::Break => {
            burst.is_break = true;
            counts.breaks += u64::from(*burst != before);
        }
    }
    *burst != before
}

/// SplitMix64: small, and the same on every machine.
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl RemoteEnd for Cable {
    fn advance(&mut self, now: Nanos) {
        self.far_end.advance(now);
    }

    fn receive(&mut self, burst: &Burst) {
        if let Some(mut arrived) = self.carry(Toward::Remote, burst) {
            arrived.start = burst.start;
            self.far_end.receive(&arrived);
        }
    }

    fn transmit(&mut self) -> Option<Burst> {
        // Bounded: each iteration takes one burst out of the remote.
        while let Some(burst) = self.far_end.transmit() {
            if let Some(arrived) = self.carry(Toward::Fpga, &burst) {
                return Some(arrived);
            }
        }
        None
    }

    fn holds_line_low(&self) -> bool {
        if self.plugged {
            self.far_end.holds_line_low()
        } else {
            self.low_when_unplugged
        }
    }

    fn inner(&self) -> Option<&dyn RemoteEnd> {
        Some(&*self.far_end)
    }

    fn inner_mut(&mut self) -> Option<&mut dyn RemoteEnd> {
        Some(&mut *self.far_end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::remote::SimRemote;

    fn cable(seed: u64) -> Cable {
        let mut remote = SimRemote::model();
        remote.apply("present=1 name=TEST mode0=1,0,0,0").unwrap();
        Cable::new(Box::new(remote), seed)
    }

    /// Requests the cookie at `at`; returns the replies.
    fn ask(cable: &mut Cable, at: Nanos) -> Vec<Burst> {
        let burst = Burst::new(at, 400, &[0xDF, 0x16]);
        cable.advance(burst.end());
        cable.receive(&burst);
        std::iter::from_fn(|| cable.transmit()).collect()
    }

    #[test]
    fn wire_fault_has_the_effect_of_its_name_and_then_ends() {
        let mut cable = cable(1);
        let good = ask(&mut cable, 0);
        assert_eq!(good[0].bytes(), [0x5A, 0xA5]);
        let faults = [
            (WireFault::Lost, Vec::new()),
            (WireFault::Short(1), vec![0x5A]),
            (WireFault::Short(2), Vec::new()),
            (WireFault::Long(2), vec![0x5A, 0xA5, 0xA5, 0xA5]),
        ];
        for (n, (fault, expected)) in (1..).zip(faults) {
            assert!(cable.inject(Toward::Fpga, fault, 1));
            let replies = ask(&mut cable, n * 2_000_000);
            let bytes = replies.first().map(|b| b.bytes().to_vec());
            assert_eq!(bytes.unwrap_or_default(), expected, "{fault:?}");
            assert_eq!(
                ask(&mut cable, n * 2_000_000 + 1_000_000)[0].bytes(),
                [0x5A, 0xA5]
            );
        }
        cable.inject(Toward::Fpga, WireFault::Break, 1);
        assert!(ask(&mut cable, 20_000_000)[0].is_break);
        cable.inject(Toward::Fpga, WireFault::Late(90_000), 1);
        assert_eq!(
            ask(&mut cable, 30_000_000)[0].start - 30_000_000,
            good[0].start + 90_000
        );
        cable.inject(Toward::Fpga, WireFault::Corrupted, 1);
        assert_ne!(ask(&mut cable, 40_000_000)[0].bytes(), [0x5A, 0xA5]);
        let counts = cable.counts(Toward::Fpga);
        assert_eq!((counts.lost, counts.short, counts.long), (2, 2, 1));
        assert_eq!((counts.breaks, counts.late, counts.corrupted), (1, 1, 1));
    }

    #[test]
    fn damaged_request_is_not_answered() {
        for fault in [
            WireFault::Lost,
            WireFault::Corrupted,
            WireFault::Short(1),
            WireFault::Break,
        ] {
            let mut cable = cable(2);
            cable.inject(Toward::Remote, fault, 1);
            assert!(ask(&mut cable, 0).is_empty(), "{fault:?}");
            assert_eq!(ask(&mut cable, 1_000_000).len(), 1, "{fault:?}");
        }
    }

    #[test]
    fn unplugged_nothing_arrives_and_plugged_again_everything_does() {
        let mut cable = cable(3);
        cable.unplug();
        assert!(ask(&mut cable, 0).is_empty());
        cable.replug();
        assert_eq!(ask(&mut cable, 1_000_000).len(), 1);
        assert_eq!(cable.counts(Toward::Remote).lost, 1);
    }

    #[test]
    fn chance_follows_the_seed_and_its_probability() {
        let run = |seed| {
            let mut cable = cable(seed);
            cable.inject_by_chance(Toward::Fpga, WireFault::Lost, 0.25);
            for n in 0..1_000 {
                ask(&mut cable, n * 1_000_000);
            }
            cable.counts(Toward::Fpga)
        };
        let seed = 0x5EED;
        assert_eq!(run(seed), run(seed));
        let counts = run(seed);
        assert!(
            (200..300).contains(&counts.lost),
            "seed {seed:#x}: {counts:?}"
        );
        assert_eq!(counts.lost + counts.intact, counts.bursts);
    }
}
