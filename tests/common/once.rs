//! A single event of a simulated board at a given time.

use core::fmt;

use mesa_hal_sim::{ChangeCause, Director, SimFpga};

/// Acts on the board once, at a time in nanoseconds.
pub struct Once<F> {
    at: Option<u64>,
    act: F,
}

impl<F: FnMut(&mut SimFpga) + Send + 'static> Once<F> {
    pub fn at(at: u64, act: F) -> Box<dyn Director> {
        Box::new(Self { at: Some(at), act })
    }
}

impl<F> fmt::Debug for Once<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Once at {:?}", self.at)
    }
}

impl<F: FnMut(&mut SimFpga) + Send> Director for Once<F> {
    fn due(&self) -> Option<u64> {
        self.at
    }

    fn act(&mut self, fpga: &mut SimFpga) {
        self.at = None;
        (self.act)(fpga);
    }

    fn drives(&mut self, _: &SimFpga, _: ChangeCause) {}
}
