//! The modules that the simulator implements.

use super::io_ports::IoPortRegisters;
use super::smart_serial::SerialModule;
use super::{
    Configuration, EncoderBank, Inputs, SimDpll, SimLeds, SimModule, SimOutputs, SimPwm,
    SimStepgen, SimWatchdog,
};
use crate::fpga::{Fabric, gtag};

/// A kind of module.
pub(crate) struct BuiltIn {
    /// GTAG of its descriptor, and of further pins of the module, whose descriptors have no
    /// registers.
    pub(crate) gtags: &'static [u8],
    /// Makes the module at the configuration of the FPGA.
    pub(crate) new: New,
}

/// Constructor of a module.
type New = fn(&Configuration<'_>) -> Box<dyn SimModule>;

/// All modules. The others of a firmware read 0.
#[rustfmt::skip]
static BUILT_IN: [BuiltIn; 14] = [
    row(&[gtag::WATCHDOG], |at| Box::new(SimWatchdog::new(at))),
    row(&[gtag::IO_PORT], |_| Box::new(IoPortRegisters)),
    row(&[gtag::ENCODER], |at| Box::new(EncoderBank::new(at))),
    row(&[gtag::MUXED_ENCODER, gtag::MUX_SELECT], |at| Box::new(EncoderBank::new(at))),
    row(&[gtag::STEPGEN], |at| Box::new(SimStepgen::new(at))),
    row(&[gtag::PWM], |at| Box::new(SimPwm::new(at))),
    row(&[gtag::DPLL], |at| Box::new(SimDpll::new(at))),
    row(&[gtag::IN_MUX], |at| Box::new(Inputs::new(at))),
    row(&[gtag::IN_M], |at| Box::new(Inputs::new(at))),
    row(&[gtag::OUT_M], |at| Box::new(SimOutputs::new(at))),
    row(&[gtag::SSR], |at| Box::new(SimOutputs::new(at))),
    row(&[gtag::LED], |_| Box::new(SimLeds::default())),
    row(&[gtag::SSERIAL], |at| Box::new(SerialModule::new(at))),
    row(&[gtag::SSERIAL_B], |at| Box::new(SerialModule::new(at))),
];

const fn row(gtags: &'static [u8], new: New) -> BuiltIn {
    BuiltIn { gtags, new }
}

/// The kind of module whose descriptor or pins have this GTAG, if the simulator implements it.
pub(crate) fn built_in(gtag: u8) -> Option<&'static BuiltIn> {
    BUILT_IN.iter().find(|row| row.gtags.contains(&gtag))
}

/// A module of a firmware that the simulator does not implement.
#[derive(Debug)]
pub(crate) struct Unsimulated;

impl SimModule for Unsimulated {
    fn read(&mut self, _: &Fabric, _: u8, _: u8) -> u32 {
        0
    }

    fn write(&mut self, _: &mut Fabric, _: u8, _: u8, _: u32) {}

    fn reload(&mut self, _: &Configuration<'_>) {}
}
