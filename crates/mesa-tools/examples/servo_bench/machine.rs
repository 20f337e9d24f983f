//! The machine around the board: simulated here, real elsewhere.

use std::time::{Duration, Instant};

use mesa_hal::bus::{Access, BusError, Clock, RegisterBus};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::devices::find_mut;
use mesa_hal_sim::{Motor, MotorConfig, MotorError, SimFpga, machines};

use crate::args::Args;

pub const AXES: usize = 6;

/// Requirements of the example beyond the board's registers.
pub trait World: RegisterBus + Clock {
    /// Wires each field output to the input of the same number. Returns true if that was done.
    fn loop_back(&mut self) -> bool;
}

impl World for UdpBus {
    fn loop_back(&mut self) -> bool {
        false
    }
}

/// The simulated machine, optionally paced by the clock.
#[derive(Debug)]
pub struct Simulated {
    fpga: SimFpga,
    /// The time at which virtual time and clock were equal.
    paced_since: Option<(Instant, u64)>,
}

/// A 7I92 with a 7I77, six motors, and a 7I72 on the expansion port.
pub fn simulated(args: &Args) -> Result<Simulated, MotorError> {
    let mut fpga = machines::i7i92_with_cards();
    // The axes of a real machine differ from each other.
    let motor = |axis: usize| {
        Motor::new(MotorConfig {
            time_constant: 0.004 + 0.001 * axis as f64,
            friction: 0.01 * axis as f64,
            ..MotorConfig::default()
        })
    };
    let motors: Vec<Motor> = (0..AXES).map(motor).collect::<Result<_, _>>()?;
    machines::wire_7i77(&mut fpga, 0, machines::ANALOG, 0, |axis| motors[axis]);
    Ok(Simulated {
        paced_since: args.realtime.then(|| (Instant::now(), 0)),
        fpga,
    })
}

impl World for Simulated {
    fn loop_back(&mut self) -> bool {
        let Some(field) = self.fpga.remote_mut(0, 0).and_then(find_mut) else {
            return false;
        };
        for n in 0..16 {
            let on = field.world().output(n) == Some(true);
            // All of these inputs exist.
            let _ = field.set_input(n, on);
        }
        true
    }
}

impl RegisterBus for Simulated {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.fpga.exchange(accesses, words)
    }
}

impl Clock for Simulated {
    fn now(&mut self) -> mesa_hal::bus::Instant {
        Clock::now(&mut self.fpga)
    }

    fn wait(&mut self, duration: Duration) {
        self.fpga.wait(duration);
        if let Some((start, origin)) = self.paced_since {
            let virtual_time = Duration::from_nanos(SimFpga::now(&self.fpga) - origin);
            if let Some(ahead) = virtual_time.checked_sub(start.elapsed()) {
                std::thread::sleep(ahead);
            }
        }
    }
}
