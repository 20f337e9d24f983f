//! Nothing in the cycle over Ethernet allocates, at either pace: a board behind a network that
//! loses, delays and duplicates packets, on virtual time. What board and network allocate is not
//! counted.

use std::time::Duration;

use allocation_counter::{measure, opt_out};
use mesa_hal::bus::{Clock, Instant, LinkError, RegisterBus};
use mesa_hal::driver::Pace;
use mesa_hal::transport::udp::{PacketLink, UdpBus, UdpConfig};
use mesa_hal_sim::{Motor, SimFpga, machines};

use crate::common::chance::Chance;
use crate::common::ethernet::{Fate, SimLink, WIRE};
use crate::common::machine::start;

const CYCLES: u32 = 1000;

/// A link to a board whose allocations do not count.
#[derive(Debug)]
pub struct Uncounted(Box<SimLink>);

impl Uncounted {
    pub fn new(fpga: SimFpga) -> Self {
        Self(Box::new(SimLink::new(fpga)))
    }

    fn uncounted<T>(&mut self, work: impl FnOnce(&mut SimLink) -> T) -> T {
        let mut done = None;
        opt_out(|| done = Some(work(&mut self.0)));
        done.expect("it was called")
    }
}

impl PacketLink for Uncounted {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        self.uncounted(|link| link.send(packet))
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        self.uncounted(|link| link.receive(buffer, deadline))
    }

    fn now(&mut self) -> Instant {
        self.0.now()
    }

    fn sleep_until(&mut self, deadline: Instant) {
        self.uncounted(|link| link.sleep_until(deadline));
    }
}

/// A network that loses, delays and doubles one packet of 30 each.
fn bad(seed: u64) -> Fate {
    let mut chance = Chance(seed);
    Box::new(move |_, _| match chance.below(30) {
        0 => vec![],
        1 => vec![WIRE + 2_500_000],
        2 => vec![WIRE, WIRE + 10_000],
        _ => vec![WIRE],
    })
}

#[test]
fn thousand_cycles_over_ethernet_allocate_nothing() {
    for pace in [Pace::Host, Pace::Board] {
        let board = Uncounted::new(machines::six_axes_7i97(Motor::default()));
        let bus = UdpBus::new(board, UdpConfig::default()).expect("the board answers");
        let mut driver = start(bus, |s| {
            s.pace = pace;
            s.bus_error_limit = 100;
        })
        .expect("the board is complete");
        let link = driver.bus_mut().link();
        (link.0.to_board, link.0.to_host) = (bad(5), bad(6));
        let mut good = 0;
        let allocated = measure(|| {
            for n in 0..CYCLES {
                good += u32::from(driver.read().is_ok());
                if n % 50 == 0 {
                    let _ = driver.rearm();
                }
                let _ = driver.write();
                if pace == Pace::Host {
                    driver.bus_mut().wait(Duration::from_micros(500));
                    driver.request_read();
                }
            }
        });
        let counted = driver.bus().statistics();
        println!("{pace:?}: {good} good of {CYCLES}, {counted:?}");
        assert_eq!(allocated.count_total, 0, "{pace:?}");
        assert!(good > CYCLES / 2, "{pace:?}: {good} good");
        assert!(counted.lost + counted.late > 0 && counted.duplicate > 0);
    }
}
