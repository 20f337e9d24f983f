//! A reset or a bite overtakes the packet that changes the direction of an I/O pin.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::ethernet::{SimLink, WIRE, bus, good};
use crate::common::machine::Machine;
use mesa_hal::bus::Clock;
use mesa_hal::driver::BoardState;
use mesa_hal::hal::{Output, Param};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::{ChangeCause, Director, SimFpga, machines};

/// I/O pins of a 7I97's expansion connector: one that is switched on, and one whose direction
/// changes.
const ON: usize = 40;
const CHANGED: usize = 42;
/// Longer than a board takes for a packet.
const PACKET: u64 = 20_000;
/// The time of the watchdog.
const WATCHDOG: u64 = 5_000_000;

#[derive(Debug, Default)]
struct Seen {
    lost_at: Option<u64>,
    bites: bool,
    lost: bool,
    on: Option<u64>,
    /// Time spans in which the pin was on after the loss.
    spans: Vec<(u64, u64)>,
}

#[derive(Clone, Debug, Default)]
struct Loss(Arc<Mutex<Seen>>);

impl Director for Loss {
    fn due(&self) -> Option<u64> {
        self.0.lock().expect("no thread panicked").lost_at
    }

    fn act(&mut self, fpga: &mut SimFpga) {
        let bites = {
            let mut seen = self.0.lock().expect("no thread panicked");
            seen.lost_at = None;
            seen.lost = true;
            seen.bites
        };
        if bites {
            // The time of the watchdog is over.
            fpga.write_register(0x0C00, 0);
        } else {
            fpga.reload();
            self.drives(fpga, ChangeCause::Reset);
        }
    }

    fn drives(&mut self, fpga: &SimFpga, cause: ChangeCause) {
        let mut seen = self.0.lock().expect("no thread panicked");
        let now = SimFpga::now(fpga);
        let is_on = fpga.is_driven(ON) && fpga.pin_level(ON);
        match seen.on {
            None if is_on => seen.on = Some(now),
            Some(since) if !is_on => {
                seen.on = None;
                if seen.lost {
                    seen.spans.push((since, now));
                }
            }
            _ => {}
        }
        seen.lost |= cause == ChangeCause::Bite;
    }
}

struct Rig {
    machine: Machine<UdpBus<SimLink>, ()>,
    loss: Loss,
    on: Output<bool>,
    changed: Param<bool>,
}

impl Rig {
    fn new() -> Self {
        let mut machine = Machine::<_, ()>::on(bus(machines::i7i97(1)), |s| {
            let none = "xxxxxxxx".parse().expect("no channels");
            s.serial_ports = [(0, none)].into();
            s.bus_error_limit = 50;
        });
        let loss = Loss::default();
        machine.fpga().set_director(Box::new(loss.clone()));
        let on = machine.output(&format!("gpio.{ON:03}.out"));
        let is_output = machine.param(&format!("gpio.{ON:03}.is_output"));
        let changed = machine.param(&format!("gpio.{CHANGED:03}.is_output"));
        machine.set_param(is_output, true);
        let mut this = Self {
            machine,
            loss,
            on,
            changed,
        };
        this.cycles(5);
        let fpga = this.machine.fpga();
        assert!(fpga.is_driven(ON) && fpga.pin_level(ON));
        this
    }

    fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            let _ = self.machine.driver.read();
            self.machine.driver.pins_mut().set(self.on, true);
            let _ = self.machine.driver.write();
            self.machine.rest();
        }
    }

    /// The board loses its set-up `after` the begin of the write; returns how long the pin was on
    /// then.
    fn loses_it(&mut self, bites: bool, after: u64) -> u64 {
        let _ = self.machine.driver.read();
        self.machine.set_param(self.changed, true);
        let at = self.machine.driver.bus_mut().now().as_nanos() + after;
        {
            let mut seen = self.loss.0.lock().expect("no thread panicked");
            (seen.lost_at, seen.bites) = (Some(at), bites);
        }
        let _ = self.machine.driver.write();
        self.machine.rest();
        self.cycles(20);
        assert_ne!(
            self.machine.driver.board_state(),
            BoardState::Running,
            "{after}"
        );
        let seen = self.loss.0.lock().expect("no thread panicked");
        assert_eq!(seen.on, None, "{bites}, {after}");
        let longest = seen.spans.iter().map(|(from, to)| to - from.max(&at));
        longest.max().unwrap_or(0)
    }

    /// The watchdog bites `after` the begin of a write, and no reply comes from then on for 30
    /// cycles; returns how long the pin was on then.
    fn bites_unheard(&mut self, after: u64) -> u64 {
        let _ = self.machine.driver.write();
        let journal = &self.machine.driver.bus_mut().link().journal;
        let fed = journal.last().expect("a packet").at + WIRE;
        let _ = self.machine.driver.read();
        self.machine.set_param(self.changed, true);
        let begin = fed + WATCHDOG - after;
        let bus = self.machine.driver.bus_mut();
        let now = bus.now().as_nanos();
        bus.wait(Duration::from_nanos(begin - now));
        self.machine.driver.bus_mut().link().to_host = Box::new(move |at, _| {
            let is_heard = at < fed + WATCHDOG;
            is_heard.then_some(WIRE).into_iter().collect()
        });
        let _ = self.machine.driver.write();
        self.machine.rest();
        self.cycles(30);
        self.machine.driver.bus_mut().link().to_host = good();
        self.cycles(20);
        let is_running = self.machine.driver.board_state() == BoardState::Running;
        let seen = self.loss.0.lock().expect("no thread panicked");
        // Without the first reply the directions are not sent, and the writes go on.
        assert_eq!(seen.lost, !is_running, "{after}");
        assert_eq!(seen.on.is_some(), is_running, "{after}");
        let longest = seen.spans.iter().map(|(from, to)| to - from);
        longest.max().unwrap_or(0)
    }
}

#[test]
fn reset_board_drives_an_io_pin_no_longer_than_one_packet() {
    let mut on = 0;
    for after in (0..300_000).step_by(5_000) {
        let longest = Rig::new().loses_it(false, after);
        assert!(longest <= PACKET, "{after}: on for {longest} ns");
        on += u32::from(longest > 0);
    }
    println!("{on} resets were overtaken");
}

#[test]
fn duplicate_packet_drives_reset_boards_pin_one_packet_at_most() {
    for late in [200_000, 500_000, 818_000] {
        let mut rig = Rig::new();
        rig.machine.driver.bus_mut().link().to_board =
            Box::new(move |_, _| vec![WIRE, WIRE + late]);
        let longest = rig.loses_it(false, 260_000);
        assert!(longest <= PACKET, "{late}: on for {longest} ns");
    }
}

#[test]
fn bitten_board_drives_an_io_pin_only_until_evidence_is_read() {
    for after in (0..300_000).step_by(5_000) {
        let mut rig = Rig::new();
        rig.machine.driver.bus_mut().link().to_board = good();
        let longest = rig.loses_it(true, after);
        assert!(longest <= 200_000, "{after}: on for {longest} ns");
    }
}

#[test]
fn bitten_board_without_replies_drives_io_pin_until_next_bite() {
    let mut on = 0;
    for after in (0..300_000).step_by(5_000) {
        let longest = Rig::new().bites_unheard(after);
        assert!(longest <= WATCHDOG + PACKET, "{after}: on for {longest} ns");
        on += u32::from(longest > PACKET);
    }
    assert!(on > 0, "no packet came after a bite");
}
