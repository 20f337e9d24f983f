//! A bus around a bus that fails when it is told to.

use core::time::Duration;

use thiserror::Error;

use super::WrappedList;
use crate::bus::{
    Access, BusError, BusErrorKind, BusStatistics, Clock, Direction, Hold, Instant, RegisterBus,
    Reply,
};

/// Injects faults into a bus: at given exchanges, or at random from a seed.
///
/// What a fault does follows from its kind, see [`Fault`]: the exchange is not executed at all, or
/// it is executed and its reply is thrown away. In both cases no word of the caller's buffer
/// changes, as [`RegisterBus::exchange`] promises.
///
/// Exchanges are numbered from 0 on, prepared or not.
///
/// # Real time
/// Does not allocate, but for the first exchanges with a buffer of more than 4096 words.
#[derive(Debug)]
pub struct Faulty<B> {
    inner: B,
    plan: Vec<(u64, Fault)>,
    random: Vec<(Fault, f64)>,
    corrupt: f64,
    penalty: Duration,
    generator: SplitMix,
    exchange: u64,
    /// What becomes of the list that was started.
    started: Option<(u64, Option<Fault>)>,
    /// Writes that were dropped since the last reply.
    unnoticed: u32,
    counted: BusStatistics,
    scratch: Vec<u32>,
}

/// What goes wrong with an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The request never arrives: nothing is executed, and the error has this kind.
    /// `Lost`, `Refused`, `Unreachable` and `Invalid` are like that in real life.
    NotExecuted(BusErrorKind),
    /// All is executed, and the reply is no good: the error has this kind. `Late`, `Stale`,
    /// `Short`, `Device`, and a `Lost` of which the reply was lost, are like that in real life.
    Executed(BusErrorKind),
    /// An exchange that only writes never arrives, and nobody says so, before the [`Reply`] of the
    /// next that reads, as on Ethernet.
    /// Exchanges that read are not concerned.
    SilentWrite,
}

impl Fault {
    /// The fault that is behind an error of this kind most often.
    pub const fn of(kind: BusErrorKind) -> Self {
        match kind {
            BusErrorKind::Lost
            | BusErrorKind::Refused
            | BusErrorKind::Unreachable
            | BusErrorKind::Occupied
            | BusErrorKind::Invalid => Self::NotExecuted(kind),
            BusErrorKind::Late
            | BusErrorKind::Stale
            | BusErrorKind::Short
            | BusErrorKind::Device
            | BusErrorKind::Other => Self::Executed(kind),
        }
    }
}

/// An error that was injected, or one of the bus inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FaultyError<E: core::error::Error + 'static> {
    /// Injected.
    #[error("exchange {exchange}: {kind:?}, injected by the test set-up")]
    Injected {
        /// Which kind was asked for.
        kind: BusErrorKind,
        /// Number of the exchange, from 0 on.
        exchange: u64,
    },
    /// A true one.
    #[error(transparent)]
    Inner(#[from] E),
}

impl<E: BusError> BusError for FaultyError<E> {
    fn kind(&self) -> BusErrorKind {
        match self {
            Self::Injected { kind, .. } => *kind,
            Self::Inner(inner) => inner.kind(),
        }
    }
}

/// Room for the buffers of all machines that fit into a packet.
const SCRATCH_WORDS: usize = 4096;

impl<B> Faulty<B> {
    /// A bus that does not fail yet. The same seed makes the same faults.
    pub fn new(inner: B, seed: u64) -> Self {
        Self {
            inner,
            plan: Vec::new(),
            random: Vec::new(),
            corrupt: 0.0,
            penalty: Duration::ZERO,
            generator: SplitMix(seed),
            exchange: 0,
            started: None,
            unnoticed: 0,
            counted: BusStatistics::default(),
            scratch: vec![0; SCRATCH_WORDS],
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

    /// Flips one bit of one word that was read, with this probability for each exchange that reads.
    /// No real bus does that unnoticed; it shows what plausibility checks are worth.
    pub fn corrupt_reads(&mut self, probability: f64) {
        self.corrupt = probability;
    }

    /// Lets so much time pass with each injected error, as a bus that waits for its deadline.
    pub fn set_penalty(&mut self, penalty: Duration) {
        self.penalty = penalty;
    }

    /// No more faults from here on.
    pub fn heal(&mut self) {
        self.plan.clear();
        self.random.clear();
        self.corrupt = 0.0;
    }

    /// Number of exchanges so far, and of the next one.
    pub fn exchanges(&self) -> u64 {
        self.exchange
    }

    /// The bus inside, to look at it.
    pub fn inner_ref(&self) -> &B {
        &self.inner
    }

    /// The bus inside.
    pub fn inner(&mut self) -> &mut B {
        &mut self.inner
    }

    /// Takes the bus out.
    pub fn into_inner(self) -> B {
        self.inner
    }

    /// What happens to this exchange. Draws the same number of random numbers whatever the plan,
    /// so that a planned fault does not change the random ones.
    fn draw(&mut self) -> (u64, Option<Fault>) {
        let number = self.exchange;
        self.exchange += 1;
        let planned = self
            .plan
            .iter()
            .find(|(at, _)| *at == number)
            .map(|(_, fault)| *fault);
        let mut drawn = None;
        for (fault, probability) in &self.random {
            let hit = self.generator.unit() < *probability;
            drawn = drawn.or(hit.then_some(*fault));
        }
        (number, planned.or(drawn))
    }
}

impl<B: RegisterBus + Clock> Faulty<B> {
    /// Executes an exchange that is not a list's, with the fault that is drawn for it.
    fn execute(
        &mut self,
        accesses: &[Access],
        words: &mut [u32],
        inner: impl Fn(&mut B, &mut [u32]) -> Result<(), B::Error>,
    ) -> Result<(), FaultyError<B::Error>> {
        let (exchange, fault) = self.draw();
        match fault {
            Some(Fault::SilentWrite) if !reads(accesses) => {
                self.unnoticed += 1;
                return Ok(());
            }
            Some(Fault::NotExecuted(kind)) => return Err(self.fail(exchange, kind)),
            Some(Fault::Executed(kind)) => {
                self.on_scratch(words, inner)?;
                return Err(self.fail(exchange, kind));
            }
            Some(Fault::SilentWrite) | None => {}
        }
        inner(&mut self.inner, words)?;
        if reads(accesses) {
            self.maybe_corrupt(accesses, words);
        }
        Ok(())
    }

    fn on_scratch<T>(
        &mut self,
        words: &[u32],
        inner: impl Fn(&mut B, &mut [u32]) -> Result<T, B::Error>,
    ) -> Result<T, B::Error> {
        if self.scratch.len() < words.len() {
            self.scratch.resize(words.len(), 0);
        }
        let scratch = self.scratch.get_mut(..words.len()).unwrap_or_default();
        for (place, word) in scratch.iter_mut().zip(words) {
            *place = *word;
        }
        inner(&mut self.inner, scratch)
    }

    fn fail(&mut self, exchange: u64, kind: BusErrorKind) -> FaultyError<B::Error> {
        self.counted.exchanges += 1;
        match kind {
            BusErrorKind::Late => self.counted.late += 1,
            BusErrorKind::Lost => self.counted.lost += 1,
            BusErrorKind::Stale => self.counted.stale += 1,
            BusErrorKind::Short => self.counted.short += 1,
            _ => {}
        }
        if !self.penalty.is_zero() {
            self.inner.wait(self.penalty);
        }
        FaultyError::Injected { kind, exchange }
    }

    /// What a reply of the bus inside tells, and what was dropped before it got there.
    fn tell(&mut self, reply: Reply) -> Reply {
        let lost = core::mem::take(&mut self.unnoticed);
        self.counted.lost_writes += u64::from(lost);
        self.counted.doubts += u64::from(lost > 0);
        Reply {
            certain: reply.certain && lost == 0,
            lost_writes: reply.lost_writes + lost,
            ..reply
        }
    }

    fn maybe_corrupt(&mut self, accesses: &[Access], words: &mut [u32]) {
        if self.generator.unit() >= self.corrupt {
            return;
        }
        let read = |access: &&Access| access.direction == Direction::Read;
        let total: usize = accesses.iter().filter(read).map(|a| a.words().len()).sum();
        let place = self.generator.below(total as u64) as usize;
        let bit = self.generator.below(32);
        let mut indices = accesses.iter().filter(read).flat_map(Access::words);
        if let Some(word) = indices.nth(place).and_then(|index| words.get_mut(index)) {
            *word ^= 1 << bit;
        }
    }
}

/// The clock is for the [penalty](Faulty::set_penalty).
impl<B: RegisterBus + Clock> RegisterBus for Faulty<B> {
    type Error = FaultyError<B::Error>;
    type List = WrappedList<B::List>;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Self::Error> {
        self.execute(accesses, words, |bus, words| bus.exchange(accesses, words))
    }

    fn prepare(
        &mut self,
        accesses: &[Access],
        hold: Option<Hold>,
    ) -> Result<Self::List, Self::Error> {
        let inner = self.inner.prepare(accesses, hold)?;
        Ok(WrappedList::new(accesses, inner))
    }

    fn start(&mut self, list: &Self::List, words: &[u32]) -> Result<(), Self::Error> {
        let (exchange, fault) = self.draw();
        self.started = Some((exchange, fault));
        match fault {
            Some(Fault::NotExecuted(_)) => Ok(()),
            Some(Fault::SilentWrite) if !reads(&list.accesses) => Ok(()),
            _ => Ok(self.inner.start(&list.inner, words)?),
        }
    }

    fn finish(&mut self, list: &Self::List, words: &mut [u32]) -> Result<Reply, Self::Error> {
        let reads = reads(&list.accesses);
        match self.started.take() {
            Some((_, Some(Fault::SilentWrite))) if !reads => {
                self.unnoticed += 1;
                return Ok(Reply::UNHEARD);
            }
            Some((exchange, Some(Fault::NotExecuted(kind)))) => {
                return Err(self.fail(exchange, kind));
            }
            Some((exchange, Some(Fault::Executed(kind)))) => {
                self.on_scratch(words, |bus, words| bus.finish(&list.inner, words))?;
                return Err(self.fail(exchange, kind));
            }
            _ => {}
        }
        let reply = self.inner.finish(&list.inner, words)?;
        if !reads {
            return Ok(reply);
        }
        self.maybe_corrupt(&list.accesses, words);
        Ok(self.tell(reply))
    }

    fn write_some(
        &mut self,
        accesses: &[Access],
        wanted: &[bool],
        words: &mut [u32],
    ) -> Result<(), Self::Error> {
        self.execute(accesses, words, |bus, words| {
            bus.write_some(accesses, wanted, words)
        })
    }

    fn can_hold(&self) -> bool {
        self.inner.can_hold()
    }

    fn set_cycle_deadline(&mut self, deadline: Duration) {
        self.inner.set_cycle_deadline(deadline);
    }

    fn follow_period(&mut self, period: Duration) {
        self.inner.follow_period(period);
    }

    /// Those of the bus inside, and the injected faults.
    fn statistics(&self) -> BusStatistics {
        let inner = self.inner.statistics();
        BusStatistics {
            exchanges: inner.exchanges + self.counted.exchanges,
            late: inner.late + self.counted.late,
            lost: inner.lost + self.counted.lost,
            stale: inner.stale + self.counted.stale,
            short: inner.short + self.counted.short,
            lost_writes: inner.lost_writes + self.counted.lost_writes,
            doubts: inner.doubts + self.counted.doubts,
            ..inner
        }
    }
}

impl<B: Clock> Clock for Faulty<B> {
    fn now(&mut self) -> Instant {
        self.inner.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.inner.wait(duration);
    }
}

fn reads(accesses: &[Access]) -> bool {
    let mut directions = accesses.iter().map(|access| access.direction);
    directions.any(|direction| direction == Direction::Read)
}

/// The SplitMix64 generator: a few lines, and the same numbers everywhere.
#[derive(Clone, Copy, Debug)]
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// 0 up to, and without, 1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// 0 up to, and without, `end`; 0 if that is 0.
    fn below(&mut self, end: u64) -> u64 {
        self.next().checked_rem(end).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests;
