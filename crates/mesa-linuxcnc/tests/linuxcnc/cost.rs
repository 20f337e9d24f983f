//! What a cycle costs the realtime thread, beside hostmot2 and hm2_eth.
//!
//! One pair of measurements, or as many as the environment variable `MESA_ETH_PAIRS` has. Page
//! faults are those of all cycles meanwhile, and of 20,000 more with that variable.
//!
//!     cargo test --release --all-features -p mesa-linuxcnc --no-run MESA_ETH_PAIRS=8 cargo test
//!     --release --all-features -p mesa-linuxcnc --test linuxcnc a_7i97_has -- --nocapture

use std::fs;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::session::Session;

/// A measurement is the median of as many short ones: another program that runs meanwhile makes
/// some of them longer.
const SAMPLES: usize = 25;
/// Duration of each.
const SAMPLE: Duration = Duration::from_millis(20);

/// Page faults that the kernel may cause where LinuxCNC cannot lock its memory. A cycle that met
/// one each time would have thousands.
const UNLOCKED: u64 = 20;

/// The realtime thread of a driver: a folder of `/proc`.
struct RealtimeThread(PathBuf);

impl RealtimeThread {
    /// Of the threads of the process that has loaded the driver, the one that works now.
    fn of(driver: &str) -> Self {
        let library = format!("/{driver}.so");
        let processes = fs::read_dir("/proc").expect("Linux has it").flatten();
        let has_loaded = |process: &PathBuf| {
            let read = |file| fs::read_to_string(process.join(file)).unwrap_or_default();
            read("comm").starts_with("rtapi_app") && read("maps").contains(&library)
        };
        let paths = processes.map(|process| process.path());
        let process = paths.into_iter().find(has_loaded);
        let tasks = fs::read_dir(process.expect("it is loaded").join("task"));
        let threads = tasks.expect("a process").flatten();
        let threads: Vec<_> = threads.map(|thread| Self(thread.path())).collect();
        let before: Vec<_> = threads.iter().map(Self::cpu).collect();
        sleep(Duration::from_millis(100));
        let used = threads.into_iter().zip(before);
        let used = used.map(|(thread, before)| (thread.cpu().saturating_sub(before), thread));
        used.max_by_key(|(used, _)| *used).expect("a thread").1
    }

    /// CPU time so far.
    fn cpu(&self) -> Duration {
        let text = fs::read_to_string(self.0.join("schedstat")).unwrap_or_default();
        let nanos = text.split(' ').next().and_then(|field| field.parse().ok());
        Duration::from_nanos(nanos.unwrap_or(0))
    }

    /// Page faults so far: fields 10 and 12, see proc(5).
    fn page_faults(&self) -> [u64; 2] {
        let text = fs::read_to_string(self.0.join("stat")).expect("it runs");
        let (_, fields) = text.rsplit_once(')').expect("a name");
        let fields: Vec<_> = fields.split_whitespace().collect();
        [fields[7], fields[9]].map(|field| field.parse().expect("a number"))
    }

    /// True if the process keeps all of its pages in memory.
    fn has_locked_memory(&self) -> bool {
        let text = fs::read_to_string(self.0.join("status")).expect("it runs");
        let locked = text.lines().find_map(|line| line.strip_prefix("VmLck:"));
        locked.is_some_and(|locked| locked.trim() != "0 kB")
    }
}

/// CPU time of each thread for 1 ms, in us, at the same time.
fn per_cycle<const N: usize>(threads: [&RealtimeThread; N]) -> [f64; N] {
    let mut samples = [const { Vec::new() }; N];
    let (mut begun, mut before) = (Instant::now(), threads.map(RealtimeThread::cpu));
    for _ in 0..SAMPLES {
        sleep(SAMPLE);
        let (now, after) = (Instant::now(), threads.map(RealtimeThread::cpu));
        let cycles = (now - begun).as_secs_f64() * 1e3;
        for (n, samples) in samples.iter_mut().enumerate() {
            let used = after[n].saturating_sub(before[n]);
            samples.push(used.as_secs_f64() * 1e6 / cycles);
        }
        (begun, before) = (now, after);
    }
    samples.map(median)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Runs hostmot2 and `mesa_eth`, each in its LinuxCNC, and prints what a cycle of 1 ms costs: side
/// by side, and one after the other.
pub fn measure(both: &mut [Session; 2]) {
    let pairs = std::env::var("MESA_ETH_PAIRS").ok();
    let pairs = pairs.map(|pairs| pairs.parse::<usize>().expect("a number"));
    for session in both.each_mut() {
        session.run();
        // Long enough for the time in which the other one runs alone.
        session.set("watchdog.timeout_ns", "4000000000");
    }
    let [hostmot2, ours] = both;
    ours.switch_on();
    let [theirs, own] = ["hm2_eth", "mesa_eth"].map(RealtimeThread::of);
    let before = own.page_faults();
    let (mut beside, mut alone) = (Vec::new(), Vec::new());
    for _ in 0..pairs.unwrap_or(1) {
        beside.push(per_cycle([&theirs, &own]));
        hostmot2.hal("stop");
        let [own_alone] = per_cycle([&own]);
        hostmot2.hal("start");
        ours.hal("stop");
        let [theirs_alone] = per_cycle([&theirs]);
        ours.hal("start");
        alone.push([theirs_alone, own_alone]);
    }
    print("side by side", &beside);
    print("one after the other", &alone);
    for session in [hostmot2, &mut *ours] {
        for fault in ["io_error", "watchdog.has_bit"] {
            if session.get(fault) == "TRUE" {
                println!("{} had a fault meanwhile: {fault}", session.prefix);
            }
        }
    }
    replace_card(ours);
    if pairs.is_some() {
        sleep(Duration::from_secs(20));
    }
    let after = own.page_faults();
    let met = after.iter().sum::<u64>() - before.iter().sum::<u64>();
    let allowed = if own.has_locked_memory() { 0 } else { UNLOCKED };
    println!(
        "page faults, minor and major: {before:?} to {after:?}, of which {allowed} are allowed"
    );
    assert!(met <= allowed, "{met} page faults");
}

/// Pulls a card and puts it back.
fn replace_card(session: &mut Session) {
    session.board("unplug 2");
    session.expect("7i72.0.2.valid", "FALSE");
    session.board("plug 2");
    session.expect("7i72.0.2.valid", "TRUE");
    session.set("7i72.0.2.rearm", "TRUE");
    session.expect_outputs([true; 3]);
}

fn print(how: &str, pairs: &[[f64; 2]]) {
    let ratios: Vec<_> = pairs.iter().map(|[theirs, ours]| ours / theirs).collect();
    println!(
        "CPU of a cycle {how}: {:.2} of hostmot2's ({ratios:.2?}); {:.1} us, hostmot2 {:.1} us{}",
        median(ratios.clone()),
        median(pairs.iter().map(|[_, ours]| *ours).collect()),
        median(pairs.iter().map(|[theirs, _]| *theirs).collect()),
        if cfg!(debug_assertions) {
            ", without optimisation"
        } else {
            ""
        },
    );
}
