//! The application of a remote: the part behind the protocol.

use super::SimMemory;
use crate::wire::Nanos;
use mesa_wire::lbp::RemoteFaults;

/// The application of a remote: the source of its inputs and the effect of its outputs.
///
/// The remote handles the protocol, modes, faults and the watchdog, and makes its calls in time
/// order. `mode` is the software mode.
pub trait Application: core::fmt::Debug + Send + 'static {
    /// Called after power-up, with the working parameters loaded.
    fn power_up(&mut self, memory: &mut SimMemory) {
        let _ = memory;
    }

    /// Advances to `now`.
    fn advance(&mut self, now: Nanos, mode: u8, memory: &SimMemory) {
        let _ = (now, mode, memory);
    }

    /// Copies the inputs into memory, before the line reads them.
    fn sample(&mut self, mode: u8, memory: &mut SimMemory) {
        let _ = (mode, memory);
    }

    /// Fills in the input data of a process-data reply, without the fault byte; initially all
    /// zeros.
    fn inputs(&mut self, mode: u8, memory: &mut SimMemory, data: &mut [u8]);

    /// True if this output data clears the faults, as on remotes without E7.
    fn clears_faults(&self, data: &[u8]) -> bool {
        let _ = data;
        false
    }

    /// Applies the output data of a process-data request. Not called while a fault is set.
    fn outputs(&mut self, mode: u8, memory: &mut SimMemory, data: &[u8]);

    /// Called after a memory write from the line. `faulty`: a fault is set, and outputs must not
    /// change.
    fn written(&mut self, mode: u8, memory: &mut SimMemory, faulty: bool) {
        let _ = (mode, memory, faulty);
    }

    /// Switches all outputs off: the watchdog has bitten, or power has failed.
    fn outputs_off(&mut self, memory: &mut SimMemory) {
        let _ = memory;
    }

    /// The faults that are present now; each stays set in the remote until the host clears it.
    fn faults(&self) -> RemoteFaults {
        RemoteFaults::empty()
    }

    /// Called after the host cleared the faults: releases latches that are not the remote's own.
    fn faults_cleared(&mut self) {}
}

/// An application with preset inputs, which only stores its outputs.
#[derive(Clone, Debug)]
pub struct FixedData {
    inputs: [u8; 32],
    outputs: [u8; 32],
    outputs_len: usize,
}

impl Default for FixedData {
    /// Inputs 11 22 33 .. FF, then 00.
    fn default() -> Self {
        let mut inputs = [0; 32];
        for (byte, n) in inputs.iter_mut().zip(1..=15) {
            *byte = 0x11 * n;
        }
        Self {
            inputs,
            outputs: [0; 32],
            outputs_len: 0,
        }
    }
}

impl FixedData {
    /// Sets the input data; bytes past it are 00.
    pub fn set_inputs(&mut self, data: &[u8]) {
        self.inputs = [0; 32];
        for (to, &from) in self.inputs.iter_mut().zip(data) {
            *to = from;
        }
    }

    /// The output data that was applied last; empty initially and after the outputs were switched
    /// off.
    pub fn outputs(&self) -> &[u8] {
        self.outputs.get(..self.outputs_len).unwrap_or(&[])
    }
}

impl Application for FixedData {
    fn inputs(&mut self, _mode: u8, _memory: &mut SimMemory, data: &mut [u8]) {
        for (to, from) in data.iter_mut().zip(self.inputs) {
            *to = from;
        }
    }

    fn outputs(&mut self, _mode: u8, _memory: &mut SimMemory, data: &[u8]) {
        self.outputs_len = data.len().min(self.outputs.len());
        for (to, &from) in self.outputs.iter_mut().zip(data) {
            *to = from;
        }
    }

    fn outputs_off(&mut self, _memory: &mut SimMemory) {
        self.outputs_len = 0;
    }
}
