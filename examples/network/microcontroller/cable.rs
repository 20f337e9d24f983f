//! In place of a network interface and a timer: a cable with a simulated board at its other end, on
//! virtual time. The board answers through a stack of its own.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::net::Ipv4Addr;
use std::rc::Rc;
use std::time::Duration;

use mesa_hal::bus::{Clock, Instant};
use mesa_hal_sim::{SimBoard, SimFpga};
use smoltcp::iface::{Config, Interface, SocketHandle, SocketSet};
use smoltcp::phy::{self, Device, DeviceCapabilities, Medium};
use smoltcp::socket::udp::{PacketBuffer, PacketMetadata, Socket};
use smoltcp::wire::{EthernetAddress, IpCidr, IpEndpoint};

/// Address and port of the board.
pub const BOARD: (Ipv4Addr, u16) = (Ipv4Addr::new(10, 10, 10, 10), 27181);

/// Time of a frame on the cable, in nanoseconds.
const WIRE: u64 = 20_000;

/// Largest Ethernet frame, without its checksum.
const FRAME: usize = 1514;

/// What happens to an IP packet on its way.
#[derive(Clone, Copy, Debug)]
#[allow(dead_code, reason = "the tests that include this file use it")]
pub enum Fate {
    /// It arrives after [`WIRE`].
    Good,
    /// It does not arrive.
    Lost,
    /// It arrives later than a good one, by this time in nanoseconds.
    Late(u64),
}

/// The frames in one direction, by the time of their arrival and the order of their sending.
#[derive(Debug, Default)]
struct Lane {
    frames: BTreeMap<(u64, u64), Vec<u8>>,
    sent: u64,
    /// The fates of the next IP packets; all others are good.
    fates: VecDeque<Fate>,
}

#[derive(Debug, Default)]
struct Wires {
    now: u64,
    to_board: Lane,
    to_host: Lane,
}

/// The simulated board, its cable, and the time that passes for both. Clones are the same.
#[derive(Clone)]
pub struct Cable {
    wires: Rc<RefCell<Wires>>,
    end: Rc<RefCell<BoardEnd>>,
}

#[allow(dead_code, reason = "the tests that include this file use all of it")]
impl Cable {
    pub fn to(board: SimBoard<SimFpga>) -> Self {
        let wires = Rc::new(RefCell::new(Wires::default()));
        let port = Port {
            wires: wires.clone(),
            is_board: true,
        };
        let end = Rc::new(RefCell::new(BoardEnd::new(port, board)));
        Self { wires, end }
    }

    /// The host's network interface.
    pub fn host(&self) -> Port {
        Port {
            wires: self.wires.clone(),
            is_board: false,
        }
    }

    /// Fates of the next IP packets to the board.
    pub fn requests(&self, fates: &[Fate]) {
        self.wires.borrow_mut().to_board.fates.extend(fates);
    }

    /// Fates of the next IP packets from the board.
    pub fn replies(&self, fates: &[Fate]) {
        self.wires.borrow_mut().to_host.fates.extend(fates);
    }

    /// Inspects the board.
    pub fn look<T>(&self, look: impl FnOnce(&mut SimBoard<SimFpga>) -> T) -> T {
        look(&mut self.end.borrow_mut().board)
    }
}

impl Clock for Cable {
    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.wires.borrow().now)
    }

    fn wait(&mut self, duration: Duration) {
        self.wires.borrow_mut().now += duration.as_nanos() as u64;
        self.end.borrow_mut().run();
    }
}

/// One end of the cable.
#[derive(Debug)]
pub struct Port {
    wires: Rc<RefCell<Wires>>,
    is_board: bool,
}

impl Device for Port {
    type RxToken<'a> = Received;
    type TxToken<'a> = Transmitter<'a>;

    fn capabilities(&self) -> DeviceCapabilities {
        let mut is = DeviceCapabilities::default();
        (is.medium, is.max_transmission_unit) = (Medium::Ethernet, FRAME);
        is
    }

    fn receive(
        &mut self,
        _: smoltcp::time::Instant,
    ) -> Option<(Self::RxToken<'_>, Self::TxToken<'_>)> {
        let mut wires = self.wires.borrow_mut();
        let now = wires.now;
        let lane = if self.is_board {
            &mut wires.to_board
        } else {
            &mut wires.to_host
        };
        let first = lane.frames.first_entry()?;
        let is_here = first.key().0 <= now;
        let frame = is_here.then(|| Received(first.remove()))?;
        drop(wires);
        Some((frame, Transmitter(self)))
    }

    fn transmit(&mut self, _: smoltcp::time::Instant) -> Option<Self::TxToken<'_>> {
        Some(Transmitter(self))
    }
}

/// A frame that has arrived.
pub struct Received(Vec<u8>);

impl phy::RxToken for Received {
    fn consume<R, F: FnOnce(&[u8]) -> R>(self, take: F) -> R {
        take(&self.0)
    }
}

/// Room for a frame to send.
pub struct Transmitter<'a>(&'a Port);

impl phy::TxToken for Transmitter<'_> {
    fn consume<R, F: FnOnce(&mut [u8]) -> R>(self, len: usize, make: F) -> R {
        let mut frame = vec![0; len];
        let made = make(&mut frame);
        let mut wires = self.0.wires.borrow_mut();
        let now = wires.now;
        let lane = if self.0.is_board {
            &mut wires.to_host
        } else {
            &mut wires.to_board
        };
        let is_ip = frame.get(12..14) == Some(&[0x08, 0x00]);
        let fate = is_ip.then(|| lane.fates.pop_front()).flatten();
        let more = match fate.unwrap_or(Fate::Good) {
            Fate::Good => 0,
            Fate::Late(more) => more,
            Fate::Lost => return made,
        };
        lane.sent += 1;
        let key = (now + WIRE + more, lane.sent);
        lane.frames.insert(key, frame);
        made
    }
}

/// The board with its network interface.
struct BoardEnd {
    board: SimBoard<SimFpga>,
    port: Port,
    interface: Interface,
    sockets: SocketSet<'static>,
    socket: SocketHandle,
    /// Replies that the board still works on: when each leaves, and its receiver.
    replies: VecDeque<(u64, IpEndpoint, Vec<u8>)>,
}

impl BoardEnd {
    fn new(mut port: Port, board: SimBoard<SimFpga>) -> Self {
        let mac = EthernetAddress([0x00, 0x60, 0x1B, 0x10, 0x00, 0x01]);
        let zero = smoltcp::time::Instant::ZERO;
        let mut interface = Interface::new(Config::new(mac.into()), &mut port, zero);
        interface.update_ip_addrs(|addresses| {
            addresses
                .push(IpCidr::new(BOARD.0.into(), 24))
                .expect("room for an address");
        });
        let buffer = || PacketBuffer::new(vec![PacketMetadata::EMPTY; 8], vec![0; 8 * FRAME]);
        let mut socket = Socket::new(buffer(), buffer());
        socket.bind(BOARD.1).expect("a port");
        let mut sockets = SocketSet::new(vec![]);
        let socket = sockets.add(socket);
        Self {
            board,
            port,
            interface,
            sockets,
            socket,
            replies: VecDeque::new(),
        }
    }

    /// Handles what has arrived, and sends what is due.
    fn run(&mut self) {
        let now = self.port.wires.borrow().now;
        self.poll(now);
        let socket = self.sockets.get_mut::<Socket<'_>>(self.socket);
        while let Ok((request, from)) = socket.recv() {
            let mut reply = Vec::new();
            if let Some(leaves) = self.board.handle_packet(now, request, &mut reply) {
                self.replies.push_back((leaves, from.endpoint, reply));
            }
        }
        self.board.advance_to(now);
        while self
            .replies
            .front()
            .is_some_and(|(leaves, ..)| *leaves <= now)
        {
            if let Some((_, to, reply)) = self.replies.pop_front() {
                socket.send_slice(&reply, to).expect("room for a reply");
            }
        }
        self.poll(now);
    }

    fn poll(&mut self, now: u64) {
        let time = smoltcp::time::Instant::from_micros((now / 1_000).cast_signed());
        self.interface.poll(time, &mut self.port, &mut self.sockets);
    }
}
