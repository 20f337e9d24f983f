//! What `mesa doctor` says about packets, of a simulated board behind a network on virtual time.
//! The truth is what the network did.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::driver::Pace;
use mesa_hal_sim::machines;
use mesa_tools::diagnosis::{FigureVerdict, Finding, PacketMark, RoundTrips, board};

use crate::common::ethernet::{Fate, WIRE, bus, good};

const PERIOD: Duration = Duration::from_millis(2);
const EXCHANGES: u32 = 300;
/// Later than 80 % of the period, which is what a cycle waits for.
const LATE: u64 = 1_900_000;

/// A network that treats one packet of `every` differently, and counts those.
fn each(every: u32, delays: Vec<u64>) -> (Fate, Rc<Cell<u64>>) {
    let counted = Rc::new(Cell::new(0));
    let (count, mut packets) = (Rc::clone(&counted), 0);
    let fate: Fate = Box::new(move |_, _| {
        packets += 1;
        if packets % every == 0 {
            count.set(count.get() + 1);
            return delays.clone();
        }
        vec![WIRE]
    });
    (fate, counted)
}

/// The findings about loss and latency, as `mesa doctor` makes them.
fn diagnose(to_board: Fate, to_host: Fate) -> [Finding; 2] {
    let mut bus = bus(machines::i7i97(1));
    let begin = PacketMark::take(&mut bus);
    bus.link().to_board = to_board;
    bus.link().to_host = to_host;
    let trips = RoundTrips::measure(&mut bus, EXCHANGES, PERIOD, || true).expect("it is reached");
    // The questions for the counts of the board are not disturbed.
    bus.link().to_board = good();
    bus.link().to_host = good();
    let packets = begin.packets_since(&mut bus, Pace::Host);
    [board::loss(&packets), board::latency(&trips, PERIOD)]
}

#[test]
fn good_network_shows_no_lost_and_no_late_packets() {
    let [loss, latency] = diagnose(good(), good());
    assert_eq!(loss.verdict, FigureVerdict::Ok, "{loss:?}");
    assert_eq!(latency.verdict, FigureVerdict::Ok, "{latency:?}");
    let said = format!("none of {EXCHANGES} replies late");
    assert!(latency.figure.starts_with(&said), "{latency:?}");
}

#[test]
fn loss_per_direction_matches_the_losses_of_the_network() {
    let (to_board, lost) = each(7, vec![]);
    let (to_host, lost_back) = each(5, vec![]);
    let [loss, _] = diagnose(to_board, to_host);
    let [lost, lost_back] = [lost.get(), lost_back.get()];
    assert!(lost > 40 && lost_back > 40, "{lost}, {lost_back}");
    assert_eq!(loss.verdict, FigureVerdict::Bad, "{loss:?}");
    let said =
        format!("packets lost, {lost} on the way to the board and {lost_back} on the way back");
    assert!(loss.figure.contains(&said), "{loss:?}, and not {said}");
    let all = format!("{} of ", lost + lost_back);
    assert!(loss.figure.starts_with(&all), "{loss:?}");
}

#[test]
fn late_replies_are_not_called_lost_nor_is_the_cable_blamed() {
    let (to_host, late) = each(3, vec![LATE]);
    let [loss, latency] = diagnose(good(), to_host);
    assert_eq!(loss.verdict, FigureVerdict::Ok, "{loss:?}");
    assert!(loss.figure.starts_with("none of 3"), "{loss:?}");
    assert_eq!(latency.verdict, FigureVerdict::Bad, "{latency:?}");
    let said = format!("{} of {EXCHANGES} replies late", late.get());
    assert!(
        latency.figure.starts_with(&said),
        "{latency:?}, and not {said}"
    );
    let advice = latency.advice.expect("advice");
    assert!(advice.contains("the cable is not the cause"), "{advice}");
}
