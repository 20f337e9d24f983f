//! The registers by their names in the transcripts.

use mesa_hal_sim::{SimFirmware, gtag};

/// A kind of register.
#[derive(Debug, PartialEq, Eq)]
pub struct Kind {
    /// Its name in a transcript.
    pub name: &'static str,
    /// The module that it belongs to.
    pub gtag: u8,
    /// Its number in the module.
    pub number: u8,
    /// Largest number of instances; 1 for a register that exists once and is written without an
    /// index.
    pub instances: u8,
    /// True if a module drives the bus when it is read; `None` if only some firmwares have it.
    pub readable: Option<bool>,
}

/// A register of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// The kind of register.
    pub kind: &'static Kind,
    /// The number of the instance or port.
    pub index: u8,
}

const fn kind(name: &'static str, gtag: u8, number: u8, instances: u8) -> Kind {
    Kind {
        name,
        gtag,
        number,
        instances,
        readable: Some(true),
    }
}

/// A register that can be read in some firmwares only: MODE with a latch, TIMER with a DPLL.
const fn optional(name: &'static str, gtag: u8, number: u8, instances: u8) -> Kind {
    Kind {
        name,
        gtag,
        number,
        instances,
        readable: None,
    }
}

const fn write_only(name: &'static str, gtag: u8, number: u8, instances: u8) -> Kind {
    Kind {
        name,
        gtag,
        number,
        instances,
        readable: Some(false),
    }
}

/// A word of the IDROM, by its number; no module.
const IDROM: Kind = kind("IDROM", 0, 0, 255);
const IDROM_ADDRESS: u16 = 0x0400;

/// All kinds. The readable ones: FACTS 12.11, 14.1.
static KINDS: [Kind; 57] = [
    IDROM,
    kind("WD_TIME", gtag::WATCHDOG, 0, 1),
    kind("WD_STATUS", gtag::WATCHDOG, 1, 1),
    write_only("WD_RESET", gtag::WATCHDOG, 2, 1),
    kind("PORT_DATA", gtag::IO_PORT, 0, 6),
    kind("PORT_DIR", gtag::IO_PORT, 1, 6),
    write_only("PORT_ALT", gtag::IO_PORT, 2, 6),
    write_only("PORT_OD", gtag::IO_PORT, 3, 6),
    write_only("PORT_INV", gtag::IO_PORT, 4, 6),
    write_only("LED", gtag::LED, 0, 1),
    kind("MENC_COUNT", gtag::MUXED_ENCODER, 0, 32),
    kind("MENC_CONTROL", gtag::MUXED_ENCODER, 1, 32),
    kind("MENC_TSDIV", gtag::MUXED_ENCODER, 2, 1),
    kind("MENC_TS", gtag::MUXED_ENCODER, 3, 1),
    write_only("MENC_RATE", gtag::MUXED_ENCODER, 4, 1),
    kind("MENC_TIMER", gtag::MUXED_ENCODER, 5, 1),
    kind("ENC_COUNT", gtag::ENCODER, 0, 32),
    kind("ENC_CONTROL", gtag::ENCODER, 1, 32),
    kind("ENC_TSDIV", gtag::ENCODER, 2, 1),
    kind("ENC_TS", gtag::ENCODER, 3, 1),
    write_only("ENC_RATE", gtag::ENCODER, 4, 1),
    kind("ENC_TIMER", gtag::ENCODER, 5, 1),
    write_only("SG_RATE", gtag::STEPGEN, 0, 64),
    kind("SG_ACCUM", gtag::STEPGEN, 1, 64),
    optional("SG_MODE", gtag::STEPGEN, 2, 64),
    write_only("SG_DIRSETUP", gtag::STEPGEN, 3, 64),
    write_only("SG_DIRHOLD", gtag::STEPGEN, 4, 64),
    write_only("SG_STEPLEN", gtag::STEPGEN, 5, 64),
    write_only("SG_STEPSPACE", gtag::STEPGEN, 6, 64),
    write_only("SG_TABLE", gtag::STEPGEN, 7, 64),
    write_only("SG_TABLEMAX", gtag::STEPGEN, 8, 64),
    kind("SG_MASTER", gtag::STEPGEN, 9, 1),
    optional("SG_TIMER", gtag::STEPGEN, 10, 1),
    write_only("PWM_VALUE", gtag::PWM, 0, 32),
    write_only("PWM_MODE", gtag::PWM, 1, 32),
    write_only("PWM_RATE", gtag::PWM, 2, 1),
    write_only("PDM_RATE", gtag::PWM, 3, 1),
    kind("PWM_ENA", gtag::PWM, 4, 1),
    kind("INMUX_CONTROL", gtag::IN_MUX, 0, 1),
    kind("INMUX_FILTER", gtag::IN_MUX, 1, 1),
    kind("INMUX_FILTERED", gtag::IN_MUX, 2, 1),
    kind("INMUX_RAW", gtag::IN_MUX, 3, 1),
    kind("INMUX_MPG", gtag::IN_MUX, 4, 1),
    kind("INM_CONTROL", gtag::IN_M, 0, 1),
    kind("INM_FILTER", gtag::IN_M, 1, 1),
    kind("INM_FILTERED", gtag::IN_M, 2, 1),
    kind("INM_RAW", gtag::IN_M, 3, 1),
    kind("INM_MPG", gtag::IN_M, 4, 1),
    kind("SSR_DATA", gtag::SSR, 0, 1),
    kind("SSR_RATE", gtag::SSR, 1, 1),
    kind("DPLL_BASE", gtag::DPLL, 0, 1),
    kind("DPLL_PHASE", gtag::DPLL, 1, 1),
    kind("DPLL_CTL0", gtag::DPLL, 2, 1),
    kind("DPLL_CTL1", gtag::DPLL, 3, 1),
    kind("DPLL_T12", gtag::DPLL, 4, 1),
    kind("DPLL_T34", gtag::DPLL, 5, 1),
    kind("DPLL_SYNC", gtag::DPLL, 6, 1),
];

impl Register {
    /// `NAME`, or `NAME[i]` for a register of several instances.
    pub fn parse(text: &str) -> Result<Self, String> {
        let unknown = || format!("unknown register: {text:?}");
        let (name, index) = match text.split_once('[') {
            None => (text, None),
            Some((name, rest)) => (name, Some(rest.strip_suffix(']').ok_or_else(unknown)?)),
        };
        let mut kinds = KINDS.iter();
        let kind = kinds.find(|kind| kind.name == name).ok_or_else(unknown)?;
        let index = match (kind.instances, index) {
            (1, None) => 0,
            (instances @ 2.., Some(index)) => index
                .parse()
                .ok()
                .filter(|&number: &u8| number < instances && number.to_string() == index)
                .ok_or_else(unknown)?,
            _ => return Err(unknown()),
        };
        Ok(Self { kind, index })
    }

    /// Its address in a firmware, from the module's descriptor; `None` if the firmware has no such
    /// register.
    pub fn address(self, firmware: &SimFirmware) -> Option<u16> {
        if *self.kind == IDROM {
            return Some(IDROM_ADDRESS + 4 * u16::from(self.index));
        }
        let module = firmware.module(self.kind.gtag)?;
        let exists = self.kind.instances == 1 || self.index < module.instances;
        // Both register strides are 0x100, and these modules have instances 4 bytes apart.
        let offset = 0x100 * u16::from(self.kind.number) + 4 * u16::from(self.index);
        exists.then(|| module.base.wrapping_add(offset))
    }
}
