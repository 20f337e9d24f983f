//! The world: inputs and motors that never stand still, and the faults, each at its time.

mod player;

pub use player::Player;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mesa_hal_sim::FaultKind;
use mesa_hal_sim::wire::Nanos;

use super::plan::{Moment, Plan, Planned};

/// A value and the time since which it holds.
pub type History<T> = Vec<(Nanos, T)>;

/// True if `holds` was true of the value at any time from `from` to `to`.
pub fn was<T: Copy>(
    history: &History<T>,
    from: u64,
    to: u64,
    mut holds: impl FnMut(T) -> bool,
) -> bool {
    let mut until = u64::MAX;
    for &(since, value) in history.iter().rev() {
        if since <= to && until >= from && holds(value) {
            return true;
        }
        if since < from {
            return false;
        }
        until = since;
    }
    false
}

/// The true inputs with their times.
#[derive(Debug, Default)]
pub struct Truth {
    /// Of each remote that has field inputs.
    pub fields: Vec<History<u32>>,
    /// Counts of their two MPGs, where they have some.
    pub mpgs: Vec<History<[u8; 2]>>,
    /// GPIO, by place in [`Gpio::inputs`].
    pub gpio: History<u64>,
    pub isolated: History<u32>,
    /// Counts of each motor, and counts per second.
    pub motors: Vec<History<(f64, f64)>>,
}

impl Truth {
    /// The least and the greatest speed of a motor in a time span.
    pub fn speeds(&self, axis: usize, from: u64, to: u64) -> (f64, f64) {
        let (mut least, mut most) = (f64::MAX, f64::MIN);
        for &(since, (_, speed)) in self.motors[axis].iter().rev() {
            if since <= to {
                (least, most) = (least.min(speed), most.max(speed));
            }
            if since <= from {
                break;
            }
        }
        (least, most)
    }

    /// The least and the greatest position of a motor in a time span.
    pub fn turned(&self, axis: usize, from: u64, to: u64) -> (f64, f64) {
        let (mut least, mut most) = (f64::MAX, f64::MIN);
        let mut until = to;
        for &(since, (counts, speed)) in self.motors[axis].iter().rev() {
            if since > to {
                continue;
            }
            for at in [from.max(since), until] {
                let position = counts + speed * (at - since) as f64 * 1e-9;
                least = least.min(position);
                most = most.max(position);
            }
            if since <= from {
                break;
            }
            until = since;
        }
        (least, most)
    }
}

#[derive(Clone, Copy, Debug)]
enum Act {
    Change,
    Begin(usize),
    /// A repeated late reply.
    Again(usize),
    /// The other card is plugged in; the number selects the card.
    Swap(usize, u64),
    End(usize),
}

/// A fault that has begun.
#[derive(Clone, Copy, Debug)]
pub struct Begun {
    pub planned: Planned,
    pub ended: Option<Nanos>,
}

#[derive(Debug)]
struct Agenda {
    acts: BTreeMap<(Nanos, usize), Act>,
    number: usize,
    /// All faults ever scheduled; an [`Act`] refers to one by its index.
    planned: Vec<Planned>,
    begun: Vec<Option<Begun>>,
    /// True if the application reports that all is well; `None` while the driver is built.
    all_is_well: Option<bool>,
    happened: Vec<(FaultKind, Moment)>,
    story: Vec<(Nanos, String)>,
    truth: Truth,
}

/// State shared by the world, the director in it and the application.
#[derive(Clone, Debug)]
pub struct Stage(Arc<Mutex<Agenda>>);

impl Stage {
    pub fn new(plan: &Plan) -> Self {
        Self(Arc::new(Mutex::new(Agenda {
            acts: BTreeMap::from([((0, 0), Act::Change)]),
            number: 0,
            planned: Vec::new(),
            begun: Vec::new(),
            all_is_well: None,
            happened: Vec::new(),
            story: Vec::new(),
            truth: Truth {
                fields: vec![Vec::new(); plan.remotes()],
                mpgs: vec![Vec::new(); plan.remotes()],
                motors: vec![Vec::new(); plan.extras.axes],
                ..Truth::default()
            },
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Agenda> {
        // The story of a scenario that has panicked while holding the lock is still needed.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn with_truth<R>(&self, look: impl FnOnce(&Truth) -> R) -> R {
        look(&self.lock().truth)
    }

    /// Schedules a fault to begin at `at`.
    pub fn schedule(&self, planned: Planned, at: Nanos) {
        let mut agenda = self.lock();
        let place = agenda.planned.len();
        agenda.planned.push(planned);
        agenda.begun.push(None);
        agenda.push(at, Act::Begin(place));
        agenda.push(at + planned.lasts, Act::End(place));
    }

    /// Ends all faults at `now`, including those that have not begun.
    pub fn end_all(&self, now: Nanos) {
        let mut agenda = self.lock();
        agenda.acts.retain(|_, act| matches!(act, Act::Change));
        let active = |begun: &Option<Begun>| begun.is_some_and(|begun| begun.ended.is_none());
        let places: Vec<_> = (0..agenda.begun.len())
            .filter(|n| active(&agenda.begun[*n]))
            .collect();
        for place in places {
            agenda.push(now, Act::End(place));
        }
    }

    /// `None` while the driver is built.
    pub fn set_well(&self, all_is_well: Option<bool>) {
        self.lock().all_is_well = all_is_well;
    }

    pub fn begun(&self) -> Vec<Begun> {
        self.lock().begun.iter().flatten().copied().collect()
    }

    pub fn happened(&self) -> Vec<(FaultKind, Moment)> {
        self.lock().happened.clone()
    }

    /// Records a fault that is caused elsewhere.
    pub fn note_fault(&self, kind: FaultKind, moment: Moment) {
        self.lock().happened.push((kind, moment));
    }

    pub fn tell(&self, at: Nanos, what: impl Into<String>) {
        self.lock().story.push((at, what.into()));
    }

    pub fn story(&self) -> Vec<(Nanos, String)> {
        let mut story = self.lock().story.clone();
        story.sort_by_key(|(at, _)| *at);
        story
    }
}

impl Agenda {
    fn push(&mut self, at: Nanos, act: Act) {
        self.number += 1;
        self.acts.insert((at, self.number), act);
    }
}
