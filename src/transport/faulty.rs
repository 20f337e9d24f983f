//! A bus wrapper that injects faults.

use alloc::vec::Vec;

use crate::bus::{
    Access, AccessList, BusError, BusErrorKind, BusLayer, BusStatistics, ClockedBus, Direction,
    Fault, Reply,
};
use crate::tally::Tally;

/// Injects faults into a bus: at given exchanges, or at random from a seed.
///
/// The effect of a fault follows from its kind, see [`Fault`]: either the exchange is not executed
/// at all, or it is executed and its reply is discarded. In both cases no word of the caller's
/// buffer changes, as [`RegisterBus::exchange`](crate::bus::RegisterBus::exchange) promises.
///
/// Exchanges are numbered from 0 on, prepared or not.
///
/// # Real time
/// Does not allocate, except for the first exchanges with a buffer of more than 4096 words.
#[derive(Debug)]
pub struct Faulty<B> {
    /// The inner bus.
    pub inner: B,
    plan: Vec<(u64, Fault)>,
    random: Vec<(Fault, f64)>,
    generator: SplitMix,
    exchange: u64,
    /// Number and fault of the list that was started.
    started: NumberedFault,
    /// Writes dropped since the last reply.
    unnoticed: u32,
    counted: BusStatistics,
    scratch: Vec<u32>,
}

/// The fault that was drawn for an exchange, if any.
#[derive(Clone, Copy, Debug, Default)]
struct NumberedFault {
    /// Number of the exchange.
    exchange: u64,
    fault: Option<Fault>,
}

/// Room for the buffers of all machines that fit into a packet.
const SCRATCH_WORDS: usize = 4096;

impl<B> Faulty<B> {
    /// A bus without faults so far. The same seed makes the same faults.
    pub fn new(inner: B, seed: u64) -> Self {
        Self {
            inner,
            plan: Vec::new(),
            random: Vec::new(),
            generator: SplitMix(seed),
            exchange: 0,
            started: NumberedFault::default(),
            unnoticed: 0,
            counted: BusStatistics::default(),
            scratch: Vec::with_capacity(SCRATCH_WORDS),
        }
    }

    /// Fails exchange number `exchange`, see [`exchanges`](Self::exchanges).
    pub fn fail_at(&mut self, exchange: u64, fault: Fault) {
        self.plan.push((exchange, fault));
    }

    /// Fails each exchange with this probability, 0 to 1. A second call for the same fault replaces
    /// the first.
    pub fn fail_randomly(&mut self, fault: Fault, probability: f64) {
        self.random.retain(|(other, _)| *other != fault);
        self.random.push((fault, probability));
    }

    /// Removes all planned and random faults.
    pub fn heal(&mut self) {
        self.plan.clear();
        self.random.clear();
    }

    /// Number of exchanges so far; also the number of the next one.
    pub fn exchanges(&self) -> u64 {
        self.exchange
    }

    /// Draws the fault of the next exchange. Consumes the same number of random numbers whatever
    /// the plan, so that a planned fault does not change the random ones.
    fn draw(&mut self) -> NumberedFault {
        let number = self.exchange;
        self.exchange.tally(1);
        let planned = self.plan.iter().find(|(at, _)| *at == number);
        let planned = planned.map(|(_, fault)| *fault);
        let mut drawn = None;
        for (fault, probability) in &self.random {
            let hit = self.generator.unit() < *probability;
            drawn = drawn.or(hit.then_some(*fault));
        }
        NumberedFault {
            exchange: number,
            fault: planned.or(drawn),
        }
    }
}

impl<B: ClockedBus> Faulty<B> {
    /// Runs an exchange on the inner bus with the fault that was drawn for it. `unheard` is the
    /// result of an exchange that was dropped silently.
    fn execute<T>(
        &mut self,
        NumberedFault { exchange, fault }: NumberedFault,
        accesses: &[Access],
        words: &mut [u32],
        unheard: T,
        inner: impl Fn(&mut B, &mut [u32]) -> Result<T, BusError>,
    ) -> Result<T, BusError> {
        match fault {
            Some(Fault::AckedButLost) if !reads(accesses) => {
                self.unnoticed.tally(1);
                Ok(unheard)
            }
            Some(Fault::NotExecuted(kind)) => Err(self.fail(exchange, kind)),
            Some(Fault::Executed(kind)) => {
                self.scratch.clear();
                self.scratch.extend_from_slice(words);
                inner(&mut self.inner, &mut self.scratch)?;
                Err(self.fail(exchange, kind))
            }
            Some(Fault::AckedButLost) | None => inner(&mut self.inner, words),
        }
    }

    fn fail(&mut self, exchange: u64, kind: BusErrorKind) -> BusError {
        self.counted.exchanges.tally(1);
        match kind {
            BusErrorKind::Late => self.counted.late.tally(1),
            BusErrorKind::Lost => self.counted.lost.tally(1),
            BusErrorKind::Stale => self.counted.stale.tally(1),
            BusErrorKind::Short => self.counted.short.tally(1),
            _ => {}
        }
        BusError::Injected { kind, exchange }
    }

    /// Counts the silently dropped writes, which an exchange that reads has found, and returns
    /// their number.
    fn count_lost(&mut self) -> u32 {
        let lost = core::mem::take(&mut self.unnoticed);
        self.counted.lost_writes.tally(lost.into());
        self.counted.doubts.tally((lost > 0).into());
        lost
    }

    /// Adds the silently dropped writes to a reply of the inner bus.
    fn tell(&mut self, reply: Reply) -> Reply {
        let lost = self.count_lost();
        reply
            .with_certain(reply.certain && lost == 0)
            .with_lost_writes(reply.lost_writes.saturating_add(lost))
    }
}

impl<B: ClockedBus> BusLayer for Faulty<B> {
    type Inner = B;

    fn inner(&self) -> &B {
        &self.inner
    }

    fn inner_mut(&mut self) -> &mut B {
        &mut self.inner
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let drawn = self.draw();
        self.execute(drawn, accesses, words, (), |bus, words| {
            bus.exchange(accesses, words)
        })?;
        if reads(accesses) {
            self.count_lost();
        }
        Ok(())
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), BusError> {
        self.started = self.draw();
        match self.started.fault {
            Some(Fault::NotExecuted(_)) => Ok(()),
            Some(Fault::AckedButLost) if !reads(list.as_ref()) => Ok(()),
            _ => self.inner.start(list, words),
        }
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        let drawn = core::mem::take(&mut self.started);
        let accesses = list.as_ref();
        let reply = self.execute(drawn, accesses, words, Reply::UNKNOWN, |bus, words| {
            bus.finish(list, words)
        })?;
        Ok(if reads(accesses) {
            self.tell(reply)
        } else {
            reply
        })
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let drawn = self.draw();
        self.execute(drawn, accesses, words, (), |bus, words| {
            bus.write_all(accesses, words)
        })
    }

    /// The statistics of the inner bus, with the injected faults added.
    fn statistics(&self) -> BusStatistics {
        let (mut all, counted) = (self.inner.statistics(), &self.counted);
        all.exchanges.tally(counted.exchanges);
        all.late.tally(counted.late);
        all.lost.tally(counted.lost);
        all.stale.tally(counted.stale);
        all.short.tally(counted.short);
        all.lost_writes.tally(counted.lost_writes);
        all.doubts.tally(counted.doubts);
        all
    }
}

fn reads(accesses: &[Access]) -> bool {
    let mut directions = accesses.iter().map(|access| access.direction);
    directions.any(|direction| direction == Direction::Read)
}

/// The SplitMix64 generator: short, and with the same numbers on every platform.
#[derive(Clone, Copy, Debug)]
struct SplitMix(u64);

impl SplitMix {
    /// A number from 0 up to, but excluding, 1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
