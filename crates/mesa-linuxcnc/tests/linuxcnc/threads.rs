//! Threads of 0.5, 1 and 2 ms: what follows the period of the thread.

use super::halcmd::{alone, skipped};
use super::session::{Session, WORDS};

/// Names of the threads, their periods in ns, and the time of the watchdog in ns that follows.
const THREADS: [(&str, u32, &str); 3] = [
    ("fast", 500_000, "5000000"),
    ("servo", 1_000_000, "5000000"),
    ("slow", 2_000_000, "10000000"),
];

/// The phase of the DPLL is printed: here it has the jitter of a computer without realtime. Over
/// virtual time `dpll_is_in_phase_with_threads_of_half_a_1_and_2_ms` has its limit, and
/// `reply_is_awaited_for_80_percent_of_the_period` that of a reply.
#[test]
fn dpll_and_watchdog_follow_the_thread() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::start();
    let threads = (1..)
        .zip(THREADS)
        .map(|(number, (name, period, _))| format!("name{number}={name} period{number}={period}"));
    session.hal(&format!(
        "loadrt threads {}",
        threads.collect::<Vec<_>>().join(" ")
    ));
    for (thread, period, watchdog) in THREADS {
        session.hal(&format!("loadrt mesa_eth {WORDS}"));
        session.set("packet-error-limit", "1000000");
        session.hal(&format!("addf .read {thread}"));
        session.hal(&format!("addf .write {thread}"));
        assert_eq!(session.get("dpll.base-freq-khz"), "-1");
        session.hal("start");
        session.expect(
            "dpll.base-freq-khz",
            &format!("{}", 1e6 / f64::from(period)),
        );
        // The frequency is shown by `read`, the time by the `write` after it.
        session.expect("watchdog.timeout_ns", watchdog);
        print_phase(&mut session, thread);
        session.hal("stop");
        session.hal("unloadrt mesa_eth");
    }
    session.stop();
}

fn print_phase(session: &mut Session, thread: &str) {
    let sample = |_| -> f64 {
        let error = session.get("dpll.phase-error-us");
        error.parse::<f64>().expect("a number").abs()
    };
    let mut errors: Vec<_> = (0..50).map(sample).collect();
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let median = errors[errors.len() / 2];
    let [late, good] =
        ["packet-error-total", "sserial.port-0.transfers"].map(|name| session.get(name));
    println!(
        "{thread}: phase error of the DPLL, mean {mean:.1} us, median {median:.1} us; replies: {late} late, \
         {good} transfers"
    );
}
