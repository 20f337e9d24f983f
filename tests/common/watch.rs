//! A director that resets a simulated FPGA at a given time and records which outputs it drives,
//! regardless of the writer.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mesa_hal_sim::{ChangeCause, Director, SimFpga};

/// Pins of a 7I97 that enable an amplifier while they are low: /ENA4, /ENA5, /ENA0 to 3. FACTS 9.2.
const LOW_ENABLES: [usize; 3] = [5, 7, 8];

/// The director; all clones share their state.
#[derive(Clone, Debug, Default)]
pub struct Watch(Arc<Mutex<Seen>>);

/// Tasks and records of the director.
#[derive(Debug, Default)]
pub struct Seen {
    /// Time at which the FPGA is reset.
    pub reset_at: Option<u64>,
    /// True while recording: always, or since the board has lost its set-up.
    pub is_noting: bool,
    /// Pins that were driven.
    pub driven: Vec<String>,
    /// Outputs that were switched on.
    pub switched_on: Vec<String>,
    /// Drives whose input was not 0 V with an open switch.
    pub volts: Vec<(usize, f64, bool)>,
}

impl Watch {
    /// Records from now on.
    pub fn now(fpga: &mut SimFpga) -> Self {
        let watch = Self::since_a_loss(fpga);
        watch.seen().is_noting = true;
        watch
    }

    /// Records from the first reset or bite on.
    pub fn since_a_loss(fpga: &mut SimFpga) -> Self {
        let watch = Self::default();
        fpga.set_director(Box::new(watch.clone()));
        watch
    }

    pub fn seen(&self) -> MutexGuard<'_, Seen> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Director for Watch {
    fn due(&self) -> Option<u64> {
        self.seen().reset_at
    }

    fn act(&mut self, fpga: &mut SimFpga) {
        let mut seen = self.seen();
        seen.reset_at = None;
        seen.is_noting = true;
        fpga.reload();
    }

    fn drives(&mut self, fpga: &SimFpga, cause: ChangeCause) {
        let mut seen = self.seen();
        seen.is_noting |= cause == ChangeCause::Bite;
        if !seen.is_noting {
            return;
        }
        let at = SimFpga::now(fpga);
        let pins = 0..fpga.firmware().pins.len();
        let driven: Vec<_> = pins
            .filter(|&pin| fpga.driven_level(pin).is_some())
            .collect();
        if !driven.is_empty() {
            seen.driven.push(format!("{at} ns, {cause:?}: {driven:?}"));
        }
        let low = LOW_ENABLES.map(|pin| fpga.driven_level(pin) == Some(false));
        let drives = [0, 1, 2, 3, 4, 5].map(|n| fpga.analog_output(n));
        let outputs = [0, 1, 2, 3, 4, 5].map(|n| fpga.isolated_output(n));
        if low.contains(&true) || drives.iter().any(|d| d.enabled) || outputs.contains(&true) {
            let what = format!("{at} ns, {cause:?}: {low:?} {drives:?} {outputs:?}");
            seen.switched_on.push(what);
        }
        for (axis, drive) in drives.iter().enumerate() {
            if drive.volts != 0.0 || drive.enabled {
                seen.volts.push((axis, drive.volts, drive.enabled));
            }
        }
    }
}
