//! The board with everything connected to it.

use std::{error::Error, fmt::Write};

use mesa_hal::boards::FlashLayout;
use mesa_hal::ethernet::Area;
use mesa_hal_sim::{
    BoardConfig, SimBoard, SimFpga,
    devices::{SimDevice, find, find_cable, find_mut},
    remote::Cable,
};

use super::configuration::configuration;
pub use super::options::MachineOptions;
use super::options::{Board, RemoteOption};
use super::plan::Plan;
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
    pub remotes: Vec<Plugged>,
    pub kind: Board,
    pub plan: Plan,
    /// True for a machine that exists only to find refused commands: nothing outside it changes.
    pub is_rehearsal: bool,
}

/// Tags in front of the two parts of a state that belong to a remote.
struct Tags {
    eeprom: [u8; TAG],
    program: [u8; TAG],
}

/// A remote and its place.
pub struct Plugged {
    pub slot: Slot,
    pub device: String,
}

impl Machine {
    /// Builds a board with everything that is plugged in.
    pub fn new(options: &MachineOptions) -> Result<Self, Box<dyn Error>> {
        let wanted = with_own_remotes(options);
        let channels = wanted.iter().map(|remote| remote.slot.channel + 1).max();
        let fpga = match &options.firmware {
            Some(image) => SimFpga::from_image(image)?,
            None => options.board.fpga(channels.unwrap_or(1)),
        };
        let name = name(&fpga);
        let mut config = BoardConfig::new(&name);
        config.ip = options.ip;
        config.mac = options.mac.unwrap_or(config.mac);
        let mut machine = Self {
            board: SimBoard::new(config, fpga),
            name,
            remotes: Vec::new(),
            kind: options.board,
            plan: options.plan.clone(),
            is_rehearsal: false,
        };
        machine.load_configurations();
        for remote in &wanted {
            let (port, channel) = (u64::from(remote.slot.port), u64::from(remote.slot.channel));
            let seed = options.seed ^ channel << 32 ^ port << 40;
            let cable = devices::build(&remote.device, remote.mode, seed)?;
            machine.add(remote, cable);
            if remote.setup {
                let now = machine.board.time();
                let device = machine.device(remote.slot)?;
                device.set_setup_jumper(now, true);
            }
        }
        mechanics::build(&mut machine)?;
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
        for remote in &self.remotes {
            let _ = writeln!(text, "channel {}: {}", remote.slot, remote.device);
        }
        mechanics::inventory(&self.plan, &mut text);
        text
    }

    /// The FPGA.
    pub fn fpga(&mut self) -> &mut SimFpga {
        self.board.gateware_mut()
    }

    /// The cable of a remote.
    pub fn cable(&mut self, slot: Slot) -> Result<&mut Cable, String> {
        let (port, channel) = slot.indices();
        let end = self.fpga().remote_mut(port, channel);
        end.and_then(|end| find_cable(end))
            .ok_or_else(|| nothing_on(slot))
    }

    /// The device of a slot, plugged in or not.
    pub fn device(&mut self, slot: Slot) -> Result<&mut dyn SimDevice, String> {
        let (port, channel) = slot.indices();
        let end = self.fpga().remote_mut(port, channel);
        end.and_then(|end| find_mut(end))
            .ok_or_else(|| nothing_on(slot))
    }

    /// Change counter of everything that the state contains.
    pub fn changes(&self) -> u64 {
        let fpga = self.board.gateware();
        let ends = self.remotes.iter();
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
        for index in 0..self.remotes.len() {
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
            for index in 0..self.remotes.len() {
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
        let (slot, device) = match self.remotes.get(index) {
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

    fn add(&mut self, remote: &RemoteOption, cable: Cable) {
        let (port, channel) = remote.slot.indices();
        self.fpga().plug(port, channel, Some(Box::new(cable)));
        self.remotes.push(Plugged {
            slot: remote.slot,
            device: remote.device.clone(),
        });
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

/// The requested remotes, and the board's own ones on channels where no other was requested.
fn with_own_remotes(options: &MachineOptions) -> Vec<RemoteOption> {
    let mut wanted = options.remotes.clone();
    for &(channel, device) in options.board.own_remotes() {
        let slot = Slot::channel(channel);
        if wanted.iter().all(|remote| remote.slot != slot) {
            wanted.push(RemoteOption {
                slot,
                device: device.to_owned(),
                mode: None,
                setup: false,
            });
        }
    }
    wanted.sort_by_key(|remote| remote.slot);
    wanted
}

fn nothing_on(slot: Slot) -> String {
    format!("no remote belongs to channel {slot}")
}
