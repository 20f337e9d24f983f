//! The board's own outputs while its watchdog has a long time, because the driver runs an operation
//! outside the cycle.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::*;
use mesa_hal::driver::DriverError;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{ChangeCause, Director};

const OUTPUT: usize = 2;

/// Records the time at which an output goes off.
#[derive(Debug)]
struct Off(Arc<AtomicU64>);

impl Director for Off {
    fn due(&self) -> Option<u64> {
        None
    }

    fn act(&mut self, _: &mut SimFpga) {}

    fn drives(&mut self, fpga: &SimFpga, _: ChangeCause) {
        if !fpga.isolated_output(OUTPUT) {
            let _ = (self.0).fetch_min(fpga.now(), Ordering::Relaxed);
        }
    }
}

#[test]
fn lost_writes_outside_the_cycle_leave_no_output_on() {
    let (mut has_failed, mut has_succeeded) = (0, 0);
    for first in 0..24 {
        for (lost, proves) in [(1, true), (3, true), (12, true), (3, false), (12, false)] {
            let bus = Faulty::new(machines::six_axes_7i97(Motor::default()), 1);
            let mut machine = started(bus);
            machine.rearm_all(100);
            let output = machine.cards.outputs[OUTPUT];
            output.set(machine.driver.pins_mut(), true);
            machine.cycles(3);
            assert!(machine.fpga().isolated_output(OUTPUT));
            let off = Arc::new(AtomicU64::new(u64::MAX));
            let _ = machine.fpga().set_director(Box::new(Off(off.clone())));
            let bus = machine.driver.bus_mut();
            let next = bus.exchanges() + first;
            (next..next + lost).for_each(|n| bus.fail_at(n, Fault::AckedButLost));
            let begun = machine.now();
            let done = if proves {
                machine.driver.prove_watchdogs()
            } else {
                let name = "nvwatchdogtimeout";
                machine.driver.write_remote_parameter((0, 2), name, 100)
            };
            match done {
                Ok(()) => has_succeeded += 1,
                Err(DriverError::NotConfirmed | DriverError::NotRunning { .. }) => has_failed += 1,
                Err(error) => panic!("{lost} from exchange {first} on, {proves}: {error}"),
            }
            let watchdog = Settings::default().watchdog_time().as_nanos() as u64;
            machine.sleep(10);
            let on = off.load(Ordering::Relaxed).saturating_sub(begun);
            // The last write before was up to two periods ago.
            let told = format!("{lost} from exchange {first} on: {} us", on / 1000);
            assert!(on <= watchdog, "{told}");
        }
    }
    assert!(has_failed > 0 && has_succeeded > 0, "{has_failed} failed");
}
