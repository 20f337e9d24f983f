//! An Ethernet board over smoltcp, a network stack for microcontrollers.

use core::time::Duration;

use mesa_hal::advice;
use mesa_hal::bus::{BusErrorKind, Clock, CustomError, Instant, LinkError};
use mesa_hal::transport::udp::PacketLink;
use smoltcp::iface::{Config, Interface, SocketHandle, SocketSet};
use smoltcp::phy::Device;
use smoltcp::socket::udp::{self, PacketBuffer, PacketMetadata, Socket};
use smoltcp::wire::{EthernetAddress, IpCidr, IpEndpoint};

/// Time between two looks at the network interface while a reply is awaited, and during a pause.
const AWAITING: Duration = Duration::from_micros(10);
const PAUSING: Duration = Duration::from_micros(100);

/// Datagrams that the socket keeps in each direction, and their bytes. A cycle sends two at most.
const PACKETS: usize = 4;
const BYTES: usize = PACKETS * 1472;

/// The addresses of this controller. Boards are in the same network.
#[derive(Clone, Copy, Debug)]
pub struct Own {
    pub mac: EthernetAddress,
    pub address: IpCidr,
    pub port: u16,
}

/// A UDP socket for one board: the network interface, its stack and a clock.
pub struct SmoltcpLink<D: Device, C: Clock> {
    device: D,
    clock: C,
    interface: Interface,
    sockets: SocketSet<'static>,
    socket: SocketHandle,
    board: IpEndpoint,
}

/// The stack takes no such address.
const CANNOT_SEND: CustomError = of_stack("smoltcp cannot send: unaddressable");
/// The stack opens no such port.
const CANNOT_BIND: CustomError = of_stack("smoltcp cannot open the port");

const fn of_stack(text: &'static str) -> CustomError {
    CustomError::new(BusErrorKind::Unreachable, text).advising(&advice::CHECK_ADDRESS)
}

impl<D: Device, C: Clock> SmoltcpLink<D, C> {
    /// A link to `board` through the interface `device`.
    pub fn new(
        mut device: D,
        mut clock: C,
        own: Own,
        board: IpEndpoint,
    ) -> Result<Self, LinkError> {
        let config = Config::new(own.mac.into());
        let mut interface = Interface::new(config, &mut device, stack_time(clock.now()));
        interface.update_ip_addrs(|addresses| {
            // There is room for the first address.
            let _ = addresses.push(own.address);
        });
        // With storage in `static` memory instead of vectors, smoltcp needs no heap.
        let buffer = || PacketBuffer::new(vec![PacketMetadata::EMPTY; PACKETS], vec![0_u8; BYTES]);
        let mut socket = Socket::new(buffer(), buffer());
        socket.bind(own.port).map_err(|_| CANNOT_BIND)?;
        let mut sockets = SocketSet::new(Vec::with_capacity(1));
        let socket = sockets.add(socket);
        Ok(Self {
            device,
            clock,
            interface,
            sockets,
            socket,
            board,
        })
    }

    /// Lets the stack send and receive; returns the time before that.
    fn poll(&mut self) -> Instant {
        let now = self.clock.now();
        let Self {
            interface,
            device,
            sockets,
            ..
        } = self;
        interface.poll(stack_time(now), device, sockets);
        now
    }

    /// Copies the next datagram of the board that has arrived.
    fn take(&mut self, buffer: &mut [u8]) -> Option<usize> {
        let socket = self.sockets.get_mut::<Socket<'_>>(self.socket);
        while let Ok((packet, from)) = socket.recv() {
            if from.endpoint == self.board {
                let bytes = buffer.iter_mut().zip(packet);
                return Some(bytes.map(|(to, from)| *to = *from).count());
            }
        }
        None
    }

    /// Waits for `time`, at most until `until`. A controller may sleep here until the interrupt of
    /// its network interface or of a timer.
    fn wait(&mut self, time: Duration, now: Instant, until: Instant) {
        self.clock.wait(until.since(now).min(time));
    }
}

impl<D: Device, C: Clock> PacketLink for SmoltcpLink<D, C> {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let socket = self.sockets.get_mut::<Socket<'_>>(self.socket);
        match socket.send_slice(packet, self.board) {
            // While the board's MAC address is not known, packets wait; more than that are lost.
            Ok(()) | Err(udp::SendError::BufferFull) => {}
            Err(udp::SendError::Unaddressable) => return Err(CANNOT_SEND.into()),
        }
        self.poll();
        Ok(())
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        loop {
            // The time is older than the look: no datagram that arrived in time is missed.
            let now = self.poll();
            let taken = self.take(buffer);
            if taken.is_some() || now >= deadline {
                return Ok(taken);
            }
            self.wait(AWAITING, now, deadline);
        }
    }

    fn now(&mut self) -> Instant {
        self.clock.now()
    }

    fn sleep_until(&mut self, deadline: Instant) {
        loop {
            let now = self.poll();
            if now >= deadline {
                return;
            }
            self.wait(PAUSING, now, deadline);
        }
    }
}

fn stack_time(now: Instant) -> smoltcp::time::Instant {
    smoltcp::time::Instant::from_micros((now.as_nanos() / 1_000).cast_signed())
}
