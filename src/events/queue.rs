//! The queue: the cycle puts events in, any thread takes them out.

use alloc::boxed::Box;
use alloc::sync::Arc;
use core::fmt;
use core::slice;
use core::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};

use super::{Event, EventKind};
use crate::bus::Instant;
use crate::packed::{Packed, WordSink};

/// The words of an event, each as its low and its high half: 64-bit atomics do not exist
/// everywhere.
type EventSlot = [[AtomicU32; 2]; Event::WORDS];

/// A ring of events: one thread at a time puts events in, any number of threads take them out.
///
/// The side of the cycle neither waits nor retries: when the ring is full, the newest events are
/// dropped and counted, because the first ones show how a fault began. Dropping ends when all kept
/// events have been taken, and then their number as [`EventKind::Dropped`]. Events are therefore
/// always taken in order.
struct Queue {
    /// Prefix of the names of the board's pins.
    board: Box<str>,
    /// The number of slots is a power of two.
    slots: Box<[EventSlot]>,
    /// The number of the next event to take out.
    head: AtomicUsize,
    /// The number of the next event to put in.
    tail: AtomicUsize,
    /// Number of events dropped so far.
    dropped: AtomicU32,
    /// Part of these that has been reported.
    known: AtomicU32,
    /// Time and cycle of the first dropped event that has not been reported.
    first_dropped: EventSlot,
    /// The number of the cycle: its low and its high half.
    cycle: [AtomicU32; 2],
    /// No further event is put in.
    has_ended: AtomicBool,
}

impl Queue {
    fn cycle(&self) -> u64 {
        load(&self.cycle)
    }

    fn slot(&self, number: usize) -> Option<&EventSlot> {
        self.slots.get(number & self.slots.len().wrapping_sub(1))
    }

    fn push(&self, event: Event) {
        let dropped = self.dropped.load(Ordering::Relaxed);
        let is_dropping = dropped != self.known.load(Ordering::Acquire);
        let tail = self.tail.load(Ordering::Relaxed);
        // Taken events are not read any more.
        let used = tail.wrapping_sub(self.head.load(Ordering::Acquire));
        if is_dropping || used >= self.slots.len() {
            if !is_dropping {
                put(&self.first_dropped, event);
            }
            self.dropped
                .store(dropped.wrapping_add(1), Ordering::Release);
        } else if let Some(slot) = self.slot(tail) {
            put(slot, event);
            self.tail.store(tail.wrapping_add(1), Ordering::Release);
        }
    }

    fn pop(&self) -> Option<Event> {
        loop {
            // Loaded before the tail, so that all events put in before these were dropped are
            // visible.
            let dropped = self.dropped.load(Ordering::Acquire);
            let head = self.head.load(Ordering::Acquire);
            if head == self.tail.load(Ordering::Acquire) {
                return self.pop_dropped(dropped);
            }
            let event = take(self.slot(head)?);
            let next = head.wrapping_add(1);
            let taken = self
                .head
                .compare_exchange(head, next, Ordering::AcqRel, Ordering::Relaxed);
            // Otherwise another thread has taken it, and the slot may have been overwritten.
            if taken.is_ok() && event.is_some() {
                return event;
            }
        }
    }

    /// Takes the number of dropped events that has not been reported, when the ring is empty.
    fn pop_dropped(&self, dropped: u32) -> Option<Event> {
        let known = self.known.load(Ordering::Acquire);
        let count = dropped.wrapping_sub(known);
        if count == 0 {
            return None;
        }
        let first = take(&self.first_dropped);
        // The slot is not overwritten before the number is reported.
        let told = self
            .known
            .compare_exchange(known, dropped, Ordering::AcqRel, Ordering::Relaxed);
        let kind = EventKind::Dropped { count };
        first
            .filter(|_| told.is_ok())
            .map(|first| Event { kind, ..first })
    }
}

fn put(slot: &EventSlot, event: Event) {
    event.pack(&mut SlotWords(slot.iter()));
}

fn take(slot: &EventSlot) -> Option<Event> {
    Event::unpack(&mut slot.iter().map(load))
}

/// The words of a slot that are not written yet.
struct SlotWords<'a>(slice::Iter<'a, [AtomicU32; 2]>);

impl WordSink for SlotWords<'_> {
    fn put(&mut self, word: u64) {
        if let Some(halves) = self.0.next() {
            store(halves, word);
        }
    }
}

fn store([low, high]: &[AtomicU32; 2], word: u64) {
    low.store(word as u32, Ordering::Relaxed);
    high.store((word >> 32) as u32, Ordering::Relaxed);
}

fn load(halves: &[AtomicU32; 2]) -> u64 {
    let [low, high] = halves
        .each_ref()
        .map(|half| u64::from(half.load(Ordering::Relaxed)));
    low | high << 32
}

impl fmt::Debug for Queue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Queue")
            .field("board", &self.board)
            .field("places", &self.slots.len())
            .field("head", &self.head)
            .field("tail", &self.tail)
            .field("dropped", &self.dropped)
            .finish_non_exhaustive()
    }
}

/// The side of the queue into which the parts of a driver put events. All of them are in one
/// thread.
///
/// # Real time
/// A bounded number of stores. No allocation, no lock.
#[derive(Clone, Debug)]
pub(crate) struct EventSink(Arc<Queue>);

impl EventSink {
    /// A queue for this number of events, rounded up to a power of two; at least for one.
    pub fn new(board: &str, room: u16) -> Self {
        let places = usize::from(room).max(1).next_power_of_two();
        Self(Arc::new(Queue {
            board: board.into(),
            slots: (0..places).map(|_| EventSlot::default()).collect(),
            head: AtomicUsize::new(0),
            tail: AtomicUsize::new(0),
            dropped: AtomicU32::new(0),
            known: AtomicU32::new(0),
            first_dropped: EventSlot::default(),
            cycle: [AtomicU32::new(0), AtomicU32::new(0)],
            has_ended: AtomicBool::new(false),
        }))
    }

    /// Sets the number of the cycle that begins.
    #[inline]
    pub fn begin_cycle(&self, number: u64) {
        store(&self.0.cycle, number);
    }

    /// Puts an event into the queue.
    #[cold]
    pub fn report(&self, at: Instant, kind: EventKind) {
        let cycle = self.0.cycle();
        self.0.push(Event { at, cycle, kind });
    }

    /// Marks the end: no further event is put in.
    pub fn end(&self) {
        self.0.has_ended.store(true, Ordering::Release);
    }

    /// The side that takes events out.
    pub fn events(&self) -> Events {
        Events(Arc::clone(&self.0))
    }
}

/// The events since the last call: an iterator that takes events out of the driver's queue, and
/// ends when the queue is empty. It can be used again later, until the driver [has
/// stopped](Self::has_ended).
///
/// The iterator may move to another thread, which takes events while the cycle runs; the cycle
/// never waits for it. Clones share the queue: each event goes to one of them. When the queue is
/// full, newer events are dropped and counted until all kept events have been taken:
/// [`EventKind::Dropped`].
///
/// # Real time
/// Taking an event is bounded, unless several threads take events at the same time. No allocation.
#[derive(Clone, Debug)]
pub struct Events(Arc<Queue>);

impl Events {
    /// Prefix of the names of the board's pins, for example `hm2_7i92.0`.
    pub fn board(&self) -> &str {
        &self.0.board
    }

    /// True if the driver has stopped, so that no event follows those in the queue. Call this first
    /// and take the events afterwards: none is then left.
    ///
    /// A thread that waits for events is not woken, because that would cost the cycle time: poll
    /// after a pause, as in the example of [`Driver::events`](crate::driver::Driver::events).
    pub fn has_ended(&self) -> bool {
        self.0.has_ended.load(Ordering::Acquire)
    }

    /// Takes all events, and writes them to the log: faults as warnings, the others as information,
    /// all with the target `mesa_hal`.
    ///
    /// # Real time
    /// Not for the cycle: the time that the logger takes is unknown.
    #[cfg(feature = "log")]
    pub fn log(&mut self) {
        while let Some(event) = self.next() {
            let level = if event.kind.is_fault() {
                log::Level::Warn
            } else {
                log::Level::Info
            };
            log::log!(target: "mesa_hal", level, "{}: {}", self.board(), event.with_advice());
        }
    }
}

impl Iterator for Events {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        self.0.pop()
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use std::thread;
    use std::vec::Vec;

    fn lost(count: u32) -> EventKind {
        EventKind::LostWrites { count }
    }

    fn kinds(events: &mut impl Iterator<Item = Event>) -> Vec<EventKind> {
        events.map(|event| event.kind).collect()
    }

    #[test]
    fn events_come_in_order_with_their_time_and_cycle() {
        let sink = EventSink::new("hm2_7i92.0", 7);
        let mut events = sink.events();
        assert_eq!(events.next(), None);
        sink.begin_cycle(0x1_0000_0005);
        sink.report(Instant::from_nanos(1_234_567_000), lost(3));
        let event = events.next().expect("an event");
        assert_eq!(event.cycle, 0x1_0000_0005);
        assert_eq!(event.kind, lost(3));
        let text = "cycle 4294967301, 1.234567 s: lost writes: 3";
        assert_eq!(event.to_string(), text);
        assert_eq!(events.next(), None, "and can be asked again");
        sink.report(Instant::default(), lost(4));
        assert_eq!(kinds(&mut events), [lost(4)]);
    }

    #[test]
    fn full_queue_keeps_the_first_events_and_counts_dropped_ones() {
        let sink = EventSink::new("", 4);
        let mut events = sink.events();
        let tell = |n: u32| sink.report(Instant::from_nanos(n.into()), lost(n));
        (1..=9).for_each(tell);
        assert_eq!(events.by_ref().take(2).count(), 2);
        // There is room, but these events would come before the dropped ones.
        (10..=11).for_each(tell);
        assert_eq!(kinds(&mut events.by_ref().take(2)), [lost(3), lost(4)]);
        let dropped = events.next().expect("how many");
        assert_eq!(dropped.kind, EventKind::Dropped { count: 7 });
        assert_eq!(dropped.at, Instant::from_nanos(5), "the first of them");
        assert_eq!(events.next(), None);
        tell(12);
        assert_eq!(kinds(&mut events), [lost(12)]);
    }

    #[test]
    fn dropped_count_is_reported_without_another_event() {
        let sink = EventSink::new("", 1);
        let mut events = sink.events();
        for round in 1..5 {
            (0..=round).for_each(|n| sink.report(Instant::default(), lost(n)));
            let dropped = EventKind::Dropped { count: round };
            assert_eq!(kinds(&mut events), [lost(0), dropped]);
        }
        drop(sink);
        assert_eq!(events.next(), None);
    }

    /// Kept and dropped events add up to all events, independent of the taking threads.
    #[test]
    fn threads_that_are_too_slow_know_of_every_event() {
        const COUNT: u32 = 200_000;
        let sink = EventSink::new("", 15);
        let is_over = Arc::new(AtomicBool::new(false));
        let takers = [sink.events(), sink.events()].map(|mut events| {
            let is_over = Arc::clone(&is_over);
            thread::spawn(move || {
                let (mut told, mut newest) = (0, 0);
                loop {
                    let was_over = is_over.load(Ordering::Acquire);
                    for event in &mut events {
                        match event.kind {
                            EventKind::Dropped { count } => told += count,
                            EventKind::LostWrites { count } => {
                                assert_eq!(u64::from(count), event.at.as_nanos());
                                assert!(count > newest, "{count} after {newest}");
                                newest = count;
                                told += 1;
                            }
                            other => panic!("{other}"),
                        }
                    }
                    if was_over {
                        return told;
                    }
                    thread::yield_now();
                }
            })
        });
        for n in 1..=COUNT {
            sink.report(Instant::from_nanos(n.into()), lost(n));
        }
        is_over.store(true, Ordering::Release);
        let told = takers.map(|taker| taker.join().expect("it ends"));
        assert_eq!(told.iter().sum::<u32>(), COUNT, "{told:?}");
    }

    #[test]
    fn threads_take_each_event_once_and_whole_during_insertion() {
        const COUNT: u32 = 20_000;
        let sink = EventSink::new("", 63);
        let takers = [sink.events(), sink.events()];
        let takers = takers.map(|mut events| {
            thread::spawn(move || {
                let mut seen = Vec::new();
                while seen.last() != Some(&COUNT) && seen.last() != Some(&u32::MAX) {
                    let Some(event) = events.next() else {
                        thread::yield_now();
                        continue;
                    };
                    match event.kind {
                        // All words belong to the same event.
                        EventKind::Rearmed { armed, waiting } => {
                            assert_eq!(u64::from(armed), event.at.as_nanos());
                            assert_eq!(u64::from(waiting), event.cycle);
                            seen.push(armed);
                        }
                        EventKind::BusDown => seen.push(u32::MAX),
                        other => panic!("{other}"),
                    }
                }
                seen
            })
        });
        let put = |n: u32, kind| {
            while sink.0.tail.load(Ordering::Relaxed) - sink.0.head.load(Ordering::Relaxed) > 60 {
                thread::yield_now();
            }
            sink.begin_cycle((n ^ 0x5555).into());
            sink.report(Instant::from_nanos(n.into()), kind);
        };
        for n in 1..=COUNT {
            let waiting = n ^ 0x5555;
            put(n, EventKind::Rearmed { armed: n, waiting });
        }
        // For the thread that did not get the last event.
        put(0, EventKind::BusDown);
        put(0, EventKind::BusDown);
        let mut all: Vec<u32> = takers
            .into_iter()
            .flat_map(|taker| taker.join().expect("it ends"))
            .filter(|n| *n != u32::MAX)
            .collect();
        all.sort_unstable();
        assert!(all.iter().copied().eq(1..=COUNT));
    }
}
