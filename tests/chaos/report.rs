//! Results of the scenarios.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use mesa_hal_sim::FaultKind;

use super::oracle::{Failure, Promise};
use super::plan::{MICRO, Moment, Plan};
use super::scenario;
use super::stage::Stage;

/// Number of failures of each promise that are printed in full.
const STORIES: usize = 2;

#[derive(Debug, Default)]
pub struct Report {
    scenarios: u64,
    /// Those with step generators, and those of them with a 7I76.
    with_steppers: [u64; 2],
    failures: BTreeMap<(Promise, u64), String>,
    happened: BTreeMap<(FaultKind, Moment), u64>,
}

impl Report {
    /// Runs one scenario.
    pub fn of(plan: &Plan) -> Self {
        let stage = Stage::new(plan);
        let result = catch_unwind(AssertUnwindSafe(|| scenario::run(plan, &stage)));
        let result = result.unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<String>().cloned();
            let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
            Err(Failure {
                promise: Promise::Works,
                at: 0,
                text: format!("panic: {}", text.unwrap_or_default()),
            })
        });
        let mut report = Self {
            scenarios: 1,
            with_steppers: [plan.steppers.count > 0, plan.steppers.is_7i76].map(u64::from),
            ..Self::default()
        };
        for happened in stage.happened() {
            *report.happened.entry(happened).or_default() += 1;
        }
        if let Err(failure) = result {
            let text = story(plan, &stage, &failure);
            report.failures.insert((failure.promise, plan.seed), text);
        }
        report
    }

    /// True if a scenario broke the promise of this name.
    pub fn breaks(&self, promise: &str) -> bool {
        let mut broken = self.failures.keys().map(|(promise, _)| promise);
        broken.any(|broken| format!("{broken:?}") == promise)
    }

    pub fn add(&mut self, other: Self) {
        self.scenarios += other.scenarios;
        for (all, more) in self.with_steppers.iter_mut().zip(other.with_steppers) {
            *all += more;
        }
        self.failures.extend(other.failures);
        for (happened, count) in other.happened {
            *self.happened.entry(happened).or_default() += count;
        }
    }

    /// Prints everything; returns true if all is well. `is_full`: every kind of fault must have
    /// occurred.
    pub fn print(&self, is_full: bool) -> bool {
        println!(
            "\n{:24} {:>9} {:>9} {:>9} {:>9}",
            "fault", "start", "discovery", "running", "recovery"
        );
        let mut absent = Vec::new();
        for kind in FaultKind::ALL {
            let counts =
                Moment::ALL.map(|moment| self.happened.get(&(*kind, moment)).copied().unwrap_or(0));
            let [a, b, c, d] = counts;
            println!("{:24} {a:9} {b:9} {c:9} {d:9}", kind.name());
            if counts.iter().sum::<u64>() == 0 {
                absent.push(kind.name());
            }
        }
        let [steppers, of_7i76] = self.with_steppers;
        println!("{steppers} scenarios have step generators, {of_7i76} of them a 7I76");
        let mut by_promise = BTreeMap::<Promise, Vec<u64>>::new();
        for ((promise, seed), text) in &self.failures {
            let seeds = by_promise.entry(*promise).or_default();
            seeds.push(*seed);
            if seeds.len() <= STORIES {
                println!("{text}");
            }
        }
        for (promise, seeds) in &by_promise {
            let first = &seeds[..seeds.len().min(12)];
            println!(
                "broken promise {promise:?}: {} scenarios, seeds {first:?}",
                seeds.len()
            );
        }
        let is_complete = absent.is_empty() || !is_full;
        if !is_complete {
            println!("these faults never occurred: {absent:?}");
        }
        let is_good = self.failures.is_empty() && is_complete;
        if is_good {
            println!("\n{} scenarios", self.scenarios);
        } else {
            println!(
                "\n{} failed of {} scenarios",
                self.failures.len(),
                self.scenarios
            );
        }
        is_good
    }
}

fn story(plan: &Plan, stage: &Stage, failure: &Failure) -> String {
    use std::fmt::Write as _;
    let mut text = format!("\nseed {}: {plan:?}\n", plan.seed);
    let told = stage.story();
    for (at, what) in &told[told.len().saturating_sub(120)..] {
        let _ = writeln!(text, "{:>10} us  {what}", at / MICRO);
    }
    let Failure {
        promise,
        at,
        text: what,
    } = failure;
    let _ = writeln!(
        text,
        "{:>10} us  broken promise {promise:?}: {what}",
        at / MICRO
    );
    text
}
