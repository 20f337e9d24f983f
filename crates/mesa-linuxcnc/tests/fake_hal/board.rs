//! A simulated 7I97 or 7I92 with a 7I77 and a 7I72, in real time on a socket.
#![allow(
    dead_code,
    reason = "each program that includes this uses what it needs"
)]

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal_sim::devices::{
    Analog, Device, FieldIo, Outputs48, SignalValue, SimDevice, World, find, find_cable, find_mut,
};
use mesa_hal_sim::remote::{Cable, SimRemote};
use mesa_hal_sim::{
    BoardConfig, Mishaps, SimBoard, SimFirmware, SimFpga, SimPinDescriptor, UdpFace, gtag, machines,
};

type Work = Box<dyn FnOnce(&mut SimBoard<SimFpga>, &mut UdpFace) + Send>;

pub struct Board {
    pub address: SocketAddr,
    work: Option<Sender<Work>>,
    thread: Option<JoinHandle<()>>,
}

pub const FIELD: usize = 0;
pub const OUTPUTS: usize = 2;

impl Board {
    /// At any free port of the loopback interface.
    pub fn start() -> Self {
        Self::start_at(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0))
    }

    pub fn start_at(address: SocketAddrV4) -> Self {
        Self::serve(address, i7i97)
    }

    /// The board with a name of `mesa sim --board`.
    pub fn start_named(name: &str, address: SocketAddrV4) -> Option<Self> {
        let fpga = match name {
            "7i97" => i7i97,
            "7i92-7i77" => i7i92,
            "7i92-7i76" => i7i92_7i76,
            "7i92-7i76-index" => i7i92_7i76_index,
            _ => return None,
        };
        Some(Self::serve(address, fpga))
    }

    /// At any free port of the loopback interface, another FPGA.
    pub fn start_with(fpga: impl FnOnce() -> SimFpga + Send + 'static) -> Self {
        Self::serve(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0), fpga)
    }

    fn serve(address: SocketAddrV4, fpga: impl FnOnce() -> SimFpga + Send + 'static) -> Self {
        let mut face = UdpFace::bind(address, Mishaps::default()).expect("a socket");
        let address = face.local_addr().expect("an address");
        let (work, orders): (Sender<Work>, Receiver<Work>) = channel();
        let thread = std::thread::spawn(move || {
            let fpga = fpga();
            let name = fpga.firmware().board;
            let name = std::str::from_utf8(&name[4..]).expect("MESA and a name");
            let mut board = SimBoard::new(BoardConfig::new(name), fpga);
            loop {
                match orders.try_recv() {
                    Ok(work) => work(&mut board, &mut face),
                    Err(std::sync::mpsc::TryRecvError::Empty) => {}
                    Err(std::sync::mpsc::TryRecvError::Disconnected) => return,
                }
                let step = face.step(&mut board, Duration::from_millis(1));
                step.expect("the socket works");
            }
        });
        Self {
            address,
            work: Some(work),
            thread: Some(thread),
        }
    }

    /// Does something with the board.
    pub fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut SimFpga, &mut UdpFace) -> T + Send + 'static,
    ) -> T {
        let (sender, result) = channel();
        let work: Work = Box::new(move |board, face| {
            let _ = sender.send(work(board.gateware_mut(), face));
        });
        let orders = self.work.as_ref().expect("it runs");
        orders.send(work).expect("it runs");
        result.recv().expect("it runs")
    }

    /// Outputs 3 of the 7I77, 17 of the 7I72, and 2 of the board, at their terminals.
    pub fn outputs(&self) -> [bool; 3] {
        let own = self.with(|fpga, _| fpga.isolated_output(2));
        [self.output(FIELD, 3), self.output(OUTPUTS, 17), own]
    }

    /// State of a digital output at the terminal of a remote.
    pub fn output(&self, channel: usize, number: usize) -> bool {
        self.with(move |fpga, _| {
            let device = find(fpga.remote(0, channel).expect("a remote")).expect("a device");
            device.outputs()[number].1 == SignalValue::Bool(true)
        })
    }

    /// The time in ms of the watchdog that a remote keeps in its memory.
    pub fn watchdog(&self, channel: usize) -> Option<u64> {
        self.with(move |fpga, _| {
            let device = find(fpga.remote(0, channel)?)?;
            let mut parameters = device.parameters().into_iter();
            let found = parameters.find(|(name, _)| name == "nvwatchdogtimeout");
            found.map(|(_, value)| value)
        })
    }

    pub fn set_input(&self, number: usize, on: bool) {
        self.with(move |fpga, _| {
            let device = find_mut(fpga.remote_mut(0, FIELD).expect("a remote"));
            device
                .expect("a device")
                .set_input(number, on)
                .expect("an input");
        });
    }

    /// Field power of a remote.
    pub fn set_field(&self, channel: usize, volts: f64) {
        self.with(move |fpga, _| {
            let now = SimFpga::now(fpga);
            let device = find_mut(fpga.remote_mut(0, channel).expect("a remote"));
            let device = device.expect("a device");
            device.set_field_volts(now, volts).expect("field power");
        });
    }

    pub fn plug(&self, channel: usize, is_in: bool) {
        self.with(move |fpga, _| {
            let cable = find_cable(fpga.remote_mut(0, channel).expect("a remote"));
            let cable = cable.expect("a cable");
            if is_in {
                cable.replug();
            } else {
                cable.unplug();
            }
        });
    }

    /// Part of the packets that are lost.
    pub fn lose(&self, loss: f64) {
        self.with(move |_, face| {
            face.set_mishaps(Mishaps {
                loss,
                ..Mishaps::default()
            });
        });
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.work = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

pub fn i7i97() -> SimFpga {
    with_cards(machines::i7i97(3))
}

pub fn i7i92() -> SimFpga {
    with_cards(machines::i7i92_7i77())
}

/// A 7I92 with a 7I76.
pub fn i7i92_7i76() -> SimFpga {
    with_7i76(machines::firmware_7i92_7i76())
}

/// The same with step generators that have index, probe and tables: version C2, and two more
/// outputs of the first generator on the free connector.
pub fn i7i92_7i76_index() -> SimFpga {
    let mut firmware = machines::firmware_7i92_7i76();
    if let Some(steps) = firmware.module_mut(gtag::STEPGEN) {
        steps.version = 0xC2;
    }
    for (pin, output) in firmware.pins.iter_mut().skip(17).zip([0x83, 0x84]) {
        *pin = SimPinDescriptor::new(gtag::STEPGEN, 0, output);
    }
    with_7i76(firmware)
}

fn with_7i76(firmware: SimFirmware) -> SimFpga {
    let mut fpga = SimFpga::new(firmware);
    plug(&mut fpga, FIELD, FieldIo::i7i76().expect("a 7I76"));
    fpga
}

fn with_cards(mut fpga: SimFpga) -> SimFpga {
    plug(&mut fpga, FIELD, FieldIo::i7i77().expect("a 7I77"));
    plug(&mut fpga, 1, Analog::i7i77().expect("a 7I77"));
    plug(&mut fpga, OUTPUTS, Outputs48::i7i72().expect("a 7I72"));
    fpga
}

/// Plugs a remote whose own watchdog has patience with a busy computer: 2 s.
fn plug<W: World>(fpga: &mut SimFpga, channel: usize, mut remote: SimRemote<Device<W>>)
where
    SimRemote<Device<W>>: SimDevice + mesa_hal_sim::wire::RemoteEnd,
{
    let address = remote.application().layout().address("NVWatchDogTimeout");
    remote
        .nonvolatile_mut()
        .set_word(address.expect("a parameter"), 2, 2_000);
    remote.set_power(0, false);
    remote.set_power(0, true);
    let cable = Cable::new(Box::new(remote), channel as u64);
    fpga.plug(0, channel, Some(Box::new(cable)));
}
