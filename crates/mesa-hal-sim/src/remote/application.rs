//! What a remote is for: the part behind the protocol.

use super::Memory;
use crate::wire::Nanos;
use mesa_wire::lbp::RemoteFaults;

/// The program of a remote: where its inputs come from and what its outputs do.
///
/// The remote takes care of the protocol, of modes, faults and the watchdog, and calls in time
/// order. `mode` is the software mode.
pub trait Application: core::fmt::Debug + Send + 'static {
    /// Power has come up and working parameters have been loaded.
    fn power_up(&mut self, memory: &mut Memory) {
        let _ = memory;
    }

    /// Time passes up to `now`.
    fn advance(&mut self, now: Nanos, mode: u8, memory: &Memory) {
        let _ = (now, mode, memory);
    }

    /// Brings the inputs into memory, before it is read from the line.
    fn sample(&mut self, mode: u8, memory: &mut Memory) {
        let _ = (mode, memory);
    }

    /// Fills in the input data of a process-data reply, the fault byte excluded; all zeros before.
    fn inputs(&mut self, mode: u8, memory: &mut Memory, data: &mut [u8]);

    /// Whether this output data clears the faults, as it does on remotes without E7.
    fn clears_faults(&self, data: &[u8]) -> bool {
        let _ = data;
        false
    }

    /// Takes over the output data of a process-data request. Not called while a fault is set.
    fn outputs(&mut self, mode: u8, memory: &mut Memory, data: &[u8]);

    /// Memory was written from the line. `faulty`: a fault is set, outputs must stay as they are.
    fn written(&mut self, mode: u8, memory: &mut Memory, faulty: bool) {
        let _ = (mode, memory, faulty);
    }

    /// Switches all outputs off: the watchdog has bitten, or power has gone.
    fn outputs_off(&mut self, memory: &mut Memory) {
        let _ = memory;
    }

    /// The faults that hold now; each stays set in the remote until the host clears it.
    fn faults(&self) -> RemoteFaults {
        RemoteFaults::empty()
    }

    /// The host cleared the faults: latches that are not the remote's own are released.
    fn faults_cleared(&mut self) {}
}

/// Inputs that are given, and outputs that are only kept.
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

    /// The output data taken over last; empty before and after the outputs went off.
    pub fn outputs(&self) -> &[u8] {
        self.outputs.get(..self.outputs_len).unwrap_or(&[])
    }
}

impl Application for FixedData {
    fn inputs(&mut self, _mode: u8, _memory: &mut Memory, data: &mut [u8]) {
        for (to, from) in data.iter_mut().zip(self.inputs) {
            *to = from;
        }
    }

    fn outputs(&mut self, _mode: u8, _memory: &mut Memory, data: &[u8]) {
        self.outputs_len = data.len().min(self.outputs.len());
        for (to, &from) in self.outputs.iter_mut().zip(data) {
            *to = from;
        }
    }

    fn outputs_off(&mut self, _memory: &mut Memory) {
        self.outputs_len = 0;
    }
}
