//! The board with everything connected to it.

use std::{error::Error, fmt::Write, net::Ipv4Addr};

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::Area;
use mesa_hal_sim::{
    BoardConfig, SimBoard, SimFpga,
    devices::{SimDevice, find},
    remote::Cable,
};

use super::description::Description;
use super::factory_flash::configuration;
use super::slot::Slot;
use super::{devices, mechanics};

/// Bytes of a remote's EEPROM, of its program, and of the tag before either in a state.
const EEPROM: usize = 0x1_0000;
const PROGRAM: usize = 0x8000;
const TAG: usize = 64;

/// Prefix of a program's tag.
const IS_PROGRAM: &str = "program ";

const DAMAGED: &str = "the part about the remotes is damaged; delete the file";

/// The board and its remotes, including unplugged ones.
pub struct Machine {
    pub board: SimBoard<SimFpga>,
    name: String,
    /// What it is built from, with the board's own remotes.
    pub description: Description,
    /// True for a machine that exists only to find refused commands: nothing outside it changes.
    pub is_rehearsal: bool,
}

/// Tags in front of the two parts of a state that belong to a remote.
struct Tags {
    eeprom: [u8; TAG],
    program: [u8; TAG],
}

impl Machine {
    /// Builds a board with everything that is plugged in.
    pub fn new(description: &Description) -> Result<Self, Box<dyn Error>> {
        let description = description.clone().with_own_remotes();
        let remotes = description.remotes.iter();
        let channels = remotes.map(|remote| remote.slot.channel + 1).max();
        let mut fpga = match &description.firmware {
            Some(image) => SimFpga::from_image(image)?,
            None => description.board.fpga(channels.unwrap_or(1)),
        };
        for remote in &description.remotes {
            let (port, channel) = (u64::from(remote.slot.port), u64::from(remote.slot.channel));
            let seed = description.seed ^ channel << 32 ^ port << 40;
            let cable = devices::build(&remote.device, remote.mode, seed)?;
            let (port, channel) = remote.slot.indices();
            fpga.plug(port, channel, Some(Box::new(cable)));
            if remote.setup {
                devices::device(&mut fpga, remote.slot)?.set_setup_jumper(0, true);
            }
        }
        mechanics::build(&mut fpga, &description)?;
        let name = name(&fpga);
        let mut config = BoardConfig::new(&name);
        config.ip = description.listen.unwrap_or(Ipv4Addr::LOCALHOST);
        config.mac = description.mac.map_or(config.mac, |mac| mac.0);
        let mut machine = Self {
            board: SimBoard::new(config, fpga),
            name,
            description,
            is_rehearsal: false,
        };
        machine.load_configurations();
        Ok(machine)
    }

    /// Loads the factory content of the flash memory: a boot block, a user configuration and a
    /// fallback configuration.
    fn load_configurations(&mut self) {
        let Some(layout) = FlashLayout::for_card(&self.name) else {
            return;
        };
        for (area, bytes) in [
            (Area::BootBlock, layout.boot_page().to_vec()),
            (Area::Fallback, configuration(1)),
            (Area::User, configuration(2)),
        ] {
            self.board.load_flash(layout.addresses(area).start, &bytes);
        }
    }

    /// Name of the board.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A readable list of remotes and mechanics.
    pub fn inventory(&self) -> String {
        let mut text = String::new();
        for remote in &self.description.remotes {
            let _ = writeln!(text, "channel {}: {}", remote.slot, remote.device);
        }
        mechanics::inventory(&self.description, &mut text);
        text
    }

    /// The FPGA.
    pub fn fpga(&mut self) -> &mut SimFpga {
        self.board.gateware_mut()
    }

    /// The cable of a remote.
    pub fn cable(&mut self, slot: Slot) -> Result<&mut Cable, String> {
        devices::cable(self.fpga(), slot)
    }

    /// The device of a slot, plugged in or not.
    pub fn device(&mut self, slot: Slot) -> Result<&mut dyn SimDevice, String> {
        devices::device(self.fpga(), slot)
    }

    /// Change counter of everything that the state contains.
    pub fn changes(&self) -> u64 {
        let fpga = self.board.gateware();
        let ends = self.description.remotes.iter();
        let ends = ends.filter_map(|remote| {
            let (port, channel) = remote.slot.indices();
            fpga.remote(port, channel)
        });
        let remotes = ends.filter_map(find).map(SimDevice::nonvolatile_changes);
        self.board.changes() + remotes.sum::<u64>()
    }

    /// The non-volatile state: the board's EEPROM and flash, then the EEPROM and the program of
    /// each remote, each behind its tag.
    pub fn state(&mut self) -> Vec<u8> {
        let mut state = self.board.state();
        for index in 0..self.description.remotes.len() {
            let (slot, tags) = self.tags(index);
            let Ok(device) = self.device(slot) else {
                continue;
            };
            state.extend(tags.eeprom);
            state.extend((0..=u16::MAX).map(|address| device.nonvolatile().byte(address)));
            if let Some(program) = device.program().filter(|cells| cells.len() == PROGRAM) {
                state.extend(tags.program);
                state.extend(program);
            }
        }
        state
    }

    /// Restores a state. Remotes that the state does not contain keep their factory settings.
    pub fn restore(&mut self, state: &[u8]) -> Result<(), Box<dyn Error>> {
        let board = self.board.state().len();
        let (board, mut kept) = state.split_at_checked(board).unwrap_or((state, &[]));
        self.board.restore(board)?;
        while let Some((tag, rest)) = kept.split_at_checked(TAG) {
            let is_program = tag.starts_with(IS_PROGRAM.as_bytes());
            let length = if is_program { PROGRAM } else { EEPROM };
            let (cells, rest) = rest.split_at_checked(length).ok_or(DAMAGED)?;
            kept = rest;
            for index in 0..self.description.remotes.len() {
                let (slot, tags) = self.tags(index);
                if tag != tags.eeprom && tag != tags.program {
                    continue;
                }
                let now = self.board.time();
                let device = self.device(slot)?;
                if is_program {
                    device.load_program(cells);
                } else {
                    device.nonvolatile_mut().load(0, cells);
                }
                // A remote applies its settings, and starts its program, at power-up.
                device.set_power(now, false);
                device.set_power(now, true);
            }
        }
        if kept.is_empty() {
            Ok(())
        } else {
            Err(DAMAGED.into())
        }
    }

    /// Slot of a remote, and its tags in a state.
    fn tags(&self, index: usize) -> (Slot, Tags) {
        let (slot, device) = match self.description.remotes.get(index) {
            Some(remote) => (remote.slot, remote.device.as_str()),
            None => (Slot::channel(0), ""),
        };
        let tag = |what: &str| {
            let mut tag = [0; TAG];
            let name = format!("{what}{slot} {device}");
            for (slot, byte) in tag.iter_mut().zip(name.bytes()) {
                *slot = byte;
            }
            tag
        };
        let tags = Tags {
            eeprom: tag(""),
            program: tag(IS_PROGRAM),
        };
        (slot, tags)
    }
}

/// Name of the card: the name in the firmware, except for cards whose names also contain the size
/// of their FPGA or denote their connectors.
fn name(fpga: &SimFpga) -> String {
    let firmware = fpga.firmware();
    let board = String::from_utf8_lossy(&firmware.board);
    let board = board
        .strip_prefix("MESA")
        .unwrap_or(&board)
        .trim_end_matches(['\0', ' ']);
    // A 7I96S and a 7I97T have an Efinix FPGA.
    let size = firmware.fpga_size;
    match (board, firmware.port_width) {
        ("7I80", 24) => format!("7I80HD-{size}"),
        ("7I80", _) => format!("7I80DB-{size}"),
        ("7I76", _) => format!("7I76E-{size}"),
        ("7I96", _) if size == 20 => "7I96S".to_owned(),
        ("7I97", _) if size == 20 => "7I97T".to_owned(),
        (board, _) => board.to_owned(),
    }
}
