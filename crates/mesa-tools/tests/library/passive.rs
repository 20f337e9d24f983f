//! A look at a running machine: what it refuses, how often it sends, and that the driver beside it,
//! `mesa-hal`'s own at 1 kHz, does not notice.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use crate::common::ethernet::{SimLink, WIRE};
use crate::common::machine::start;
use mesa_hal::MesaError;
use mesa_hal::bus::{
    Access, BusError, BusErrorKind, Clock, CustomError, Instant, LinkError, RegisterBus,
};
use mesa_hal::driver::{Driver, EventMask, Pace};
use mesa_hal::ethernet::{EthernetBoard, Lbp16Board};
use mesa_hal::hal::AnyValue;
use mesa_hal::lbp16::{Operations, Space};
use mesa_hal::transport::ReadRefusal;
use mesa_hal::transport::udp::{PacketLink, UdpBus, UdpConfig};
use mesa_hal_sim::{Motor, machines};
use mesa_tools::inventory::InventoryEthernet;
use mesa_tools::passive::{PassiveBus, PassiveError, PassiveInventory, Read, Sample, Watched};

const PERIOD: Duration = Duration::from_millis(1);
const DEADLINE: Duration = Duration::from_millis(200);

/// The count of the first encoder of the simulated 7I97.
const COUNT: u16 = 0x3600;

/// A machine that a driver runs at 1 kHz, and packets of a look at it.
struct Machine {
    driver: Driver<UdpBus<SimLink>>,
    pace: Pace,
    cycles: u32,
    failed: u32,
    not_good: u32,
    /// Cycles in which the input of a remote was older than three cycles.
    stale: u32,
}

impl Machine {
    /// A cycle: the packets of the look reach the board before it, or between read and write.
    fn cycle(&mut self) {
        let report = self.driver.read().expect("a good network");
        self.failed += report.failed;
        self.not_good += u32::from(!report.is_good());
        let input = self
            .driver
            .pins()
            .input::<bool>("hm2_7i97.0.7i77.0.0.input-00");
        let reading = self.driver.pins().read(input.expect("an input"));
        self.stale += u32::from(reading.within(3).is_none());
        self.driver.write().expect("a good network");
        if self.pace == Pace::Host {
            self.driver.bus_mut().wait(PERIOD);
        }
        self.cycles += 1;
    }

    fn now(&mut self) -> u64 {
        self.driver.bus_mut().link().time()
    }
}

/// The socket of a look: time passes in cycles of the driver.
#[derive(Clone)]
struct Beside {
    machine: Rc<RefCell<Machine>>,
    /// Requests, with their times.
    sent: Vec<(u64, Vec<u8>)>,
    replies: VecDeque<(u64, Vec<u8>)>,
    lengths: Vec<usize>,
    /// Fate of the next replies: lost, or that much later.
    fates: VecDeque<Option<u64>>,
}

impl Beside {
    fn new(machine: &Rc<RefCell<Machine>>) -> Self {
        Self {
            machine: Rc::clone(machine),
            sent: Vec::new(),
            replies: VecDeque::new(),
            lengths: Vec::new(),
            fates: VecDeque::new(),
        }
    }

    fn time(&self) -> u64 {
        self.machine.borrow_mut().now()
    }
}

impl PacketLink for Beside {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let mut machine = self.machine.borrow_mut();
        let now = machine.now();
        let board = &mut machine.driver.bus_mut().link().board;
        let mut reply = Vec::new();
        let leaves = board.handle_packet(board.time(), packet, &mut reply);
        self.sent.push((now, packet.to_vec()));
        self.lengths.push(reply.len());
        let fate = self.fates.pop_front().unwrap_or(Some(0));
        if let (Some(leaves), Some(more)) = (leaves, fate) {
            self.replies.push_back((leaves + WIRE + more, reply));
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], until: Instant) -> Result<Option<usize>, LinkError> {
        loop {
            let now = self.time();
            let next = self.replies.iter().position(|(arrives, _)| *arrives <= now);
            if let Some((_, reply)) = next.and_then(|next| self.replies.remove(next)) {
                buffer[..reply.len()].copy_from_slice(&reply);
                return Ok(Some(reply.len()));
            }
            if now >= until.as_nanos() {
                return Ok(None);
            }
            self.machine.borrow_mut().cycle();
        }
    }

    fn now(&mut self) -> Instant {
        Instant::from_nanos(self.time())
    }

    fn sleep_until(&mut self, deadline: Instant) {
        while self.time() < deadline.as_nanos() {
            self.machine.borrow_mut().cycle();
        }
    }
}

fn machine() -> Rc<RefCell<Machine>> {
    machine_paced(Pace::Host)
}

fn machine_paced(pace: Pace) -> Rc<RefCell<Machine>> {
    let link = SimLink::new(machines::six_axes_7i97(Motor::default()));
    let bus = UdpBus::new(link, UdpConfig::default()).expect("the board answers");
    let driver = start(bus, |settings| {
        (settings.period, settings.pace) = (PERIOD, pace);
    })
    .expect("the machine is complete");
    let mut machine = Machine {
        driver,
        pace,
        cycles: 0,
        failed: 0,
        not_good: 0,
        stale: 0,
    };
    for _ in 0..200 {
        machine.cycle();
    }
    (machine.failed, machine.not_good, machine.cycles) = (0, 0, 0);
    machine.stale = 0;
    Rc::new(RefCell::new(machine))
}

fn look(machine: &Rc<RefCell<Machine>>) -> PassiveBus<Beside> {
    PassiveBus::new(Beside::new(machine), DEADLINE)
}

fn is_write(packet: &[u8]) -> bool {
    Operations::new(packet).any(|operation| operation.expect("a command").command.write)
}

#[test]
fn driver_at_1_khz_notices_nothing_of_a_look() {
    for pace in [Pace::Host, Pace::Board] {
        look_beside(pace);
    }
}

fn look_beside(pace: Pace) {
    let machine = machine_paced(pace);
    let mut bus = look(&machine);
    let begin = machine.borrow().driver.statistics();
    let before = machine.borrow_mut().driver.bus_mut().statistics().doubts;
    let ethernet = InventoryEthernet::read(&mut EthernetBoard::new(&mut bus)).expect("a board");
    let mut watched = Watched::new(bus).expect("a 7I97");
    let inventory = PassiveInventory::take(&mut watched, ethernet).expect("a 7I97");
    let rate = inventory.others_per_second;
    // One packet in each cycle, or two in a millisecond and the time of an exchange.
    let expected = if pace == Pace::Host {
        1800.0..2000.0
    } else {
        900.0..1010.0
    };
    assert!(expected.contains(&rate), "{rate} packets a second");
    let inventoried = watched.bus().packets().packets;
    for _ in 0..60 {
        watched.sample().expect("a board");
    }
    let packets = watched.bus().packets().packets;
    assert!(packets > inventoried + 60, "{packets} packets");
    assert!(packets > 100, "{packets}");
    let machine = &mut *machine.borrow_mut();
    assert!(machine.cycles > 5000, "{} cycles", machine.cycles);
    let Machine {
        failed,
        not_good,
        stale,
        ..
    } = *machine;
    assert_eq!(
        [failed, not_good, stale],
        [0; 3],
        "of {} cycles",
        machine.cycles
    );
    let end = machine.driver.statistics();
    assert_eq!((begin.foreign_packets, end.foreign_packets), (0, 0));
    assert_eq!(begin.read_errors, end.read_errors);
    assert_eq!(begin.lost_writes, end.lost_writes);
    let told = machine.driver.events();
    let told = told.filter(|event| event.kind.mask() == EventMask::OTHER_MASTER);
    assert_eq!(told.count(), 0);
    // The driver does not use the inputs of remotes in at most two cycles for each packet.
    let doubts = machine.driver.bus_mut().statistics().doubts - before;
    println!(
        "{} cycles, {packets} packets, {doubts} doubts",
        machine.cycles
    );
    assert!(doubts <= 2 * packets, "{doubts} doubts, {packets} packets");
}

/// The same questions without the limit: the driver takes them for those of another master, so that
/// the test above can fail.
#[test]
fn same_requests_without_a_limit_count_as_a_second_master() {
    let machine = machine();
    let mut bus = look(&machine);
    bus.identify().expect("a 7I97");
    let mut link = bus.link().clone();
    let packets: Vec<_> = link.sent.iter().map(|(_, packet)| packet.clone()).collect();
    for packet in packets.iter().cycle().take(2000) {
        link.send(packet).expect("a good network");
        machine.borrow_mut().cycle();
    }
    let machine = machine.borrow();
    assert!(machine.driver.statistics().foreign_packets > 100);
}

#[test]
fn passive_inventory_writes_nothing_and_causes_no_board_error() {
    let machine = machine();
    let mut bus = look(&machine);
    let before = EthernetBoard::new(&mut bus).counters().expect("a board");
    let ethernet = InventoryEthernet::read(&mut EthernetBoard::new(&mut bus)).expect("a board");
    let mut watched = Watched::new(bus).expect("a 7I97");
    PassiveInventory::take(&mut watched, ethernet).expect("a 7I97");
    let bus = watched.bus();
    let map = bus.map().expect("identified").clone();
    let reads: Vec<_> = map
        .readable()
        .map(|r| Read::hostmot2(r.address, 1))
        .collect();
    bus.read_all(&reads).expect("a board");
    assert!(reads.len() > 40, "{} registers", reads.len());
    let after = EthernetBoard::new(bus).counters().expect("a board");
    assert_eq!(
        (
            before.errors,
            before.parse_errors,
            before.memory_errors,
            before.write_errors
        ),
        (
            after.errors,
            after.parse_errors,
            after.memory_errors,
            after.write_errors
        )
    );
    let sent = &bus.link().sent;
    assert!(sent.len() > 10 && !sent.iter().any(|(_, packet)| is_write(packet)));
    // That of the driver beside it is seen as one.
    assert!(is_write(&[0x82, 0xD1, 0x1C, 0x00, 1, 0, 0, 0]));
}

/// True for an error that refuses a read, with the reason.
fn refusal(error: PassiveError) -> ReadRefusal {
    match error {
        PassiveError::Refused { refusal, .. } => refusal,
        other => panic!("{other}"),
    }
}

/// The error of an exchange that would read the register at this address.
fn not_read(address: u16) -> BusError {
    let text = "a register that is not read beside a running program";
    let error = CustomError::new(BusErrorKind::Invalid, text);
    error.with_code(address.into()).into()
}

#[test]
fn writes_and_reads_with_side_effects_are_refused_unsent() {
    let machine = machine();
    let mut bus = look(&machine);
    let early = bus.read_all(&[Read::hostmot2(COUNT, 1)]);
    let early = early.expect_err("not identified yet");
    assert_eq!(refusal(early), ReadRefusal::NoRegister);
    assert_eq!(bus.read(COUNT), Err(not_read(COUNT)));
    bus.identify().expect("a 7I97");
    let sent = bus.link().sent.len();
    let write = BusError::from(PassiveError::Write);
    assert_eq!(bus.write(0x0D00, 0), Err(write));
    let both = [Access::read(0x0D00, 0, 1), Access::write(0x0D00, 1, 1)];
    assert_eq!(bus.exchange(&both, &mut [0; 2]), Err(write));
    // A scratch register, in which a driver numbers its requests, then a read of it; a reset.
    let number = [0x82, 0xD1, 0x1C, 0x00, 1, 0, 0, 0, 0x42, 0x51, 0x1C, 0x00];
    let mut reply = [0; 4];
    assert_eq!(bus.run_commands(&number, &mut reply, DEADLINE), Err(write));
    assert_eq!(Lbp16Board::send(&mut bus, &number), Err(write));
    assert_eq!(
        EthernetBoard::new(&mut bus)
            .clear_errors()
            .map_err(|e| e.to_string()),
        Err(PassiveError::Write.to_string())
    );
    check_refused_registers(&mut bus);
    // One register of many is enough; and a command without an address reads anywhere.
    let both = [0x7500, 0x7600].map(|address| Read::hostmot2(address, 1));
    assert!(bus.read_all(&both).is_err());
    let standing = [0x01, 0x02];
    let refused = bus.run_commands(&standing, &mut reply, DEADLINE);
    assert_eq!(refused, Err(not_read(0)));
    assert_eq!(bus.link().sent.len(), sent, "nothing was sent");
    check_readable_registers(&mut bus);
}

fn read(bus: &mut PassiveBus<Beside>, space: Space, address: u16) -> Result<(), ReadRefusal> {
    let count = 1;
    let read = Read {
        space,
        address,
        count,
    };
    bus.read_all(&[read]).map(drop).map_err(refusal)
}

fn check_refused_registers(bus: &mut PassiveBus<Beside>) {
    for (space, address) in [
        // SYNC of the DPLL marks the time of a cycle. FACTS 12.4, REGISTERS.
        (Space::HostMot2, 0x7600),
        // The data port of the flash memory advances; the wait for the DPLL holds the board.
        (Space::Flash, 0x04),
        (Space::Timer, 0x06),
        (Space::Timer, 0x08),
        (Space::EthernetChip, 0x10),
        (Space::Control, 0x1C),
        (Space::Control, 0x1E),
    ] {
        let result = read(bus, space, address);
        let is_effect = matches!(result, Err(ReadRefusal::SideEffect(_)));
        assert!(is_effect, "{space} {address:#x}: {result:?}");
    }
    for (space, address, expected) in [
        (Space::HostMot2, 0x4100, ReadRefusal::WriteOnly),
        (Space::HostMot2, 0x0E00, ReadRefusal::WriteOnly),
        (Space::HostMot2, 0x0200, ReadRefusal::WriteOnly),
        (Space::HostMot2, 0x0000, ReadRefusal::NoRegister),
        (Space::HostMot2, 0xFFFC, ReadRefusal::NoRegister),
        // The board counts an access behind the end as an error.
        (Space::Eeprom, 0x80, ReadRefusal::NoRegister),
        (Space::Unused, 0, ReadRefusal::NoRegister),
    ] {
        assert_eq!(
            read(bus, space, address),
            Err(expected),
            "{space} {address:#x}"
        );
    }
}

/// What is next to those that are refused is read.
fn check_readable_registers(bus: &mut PassiveBus<Beside>) {
    for (space, address) in [
        (Space::HostMot2, 0x7100),
        (Space::HostMot2, COUNT),
        (Space::HostMot2, 0x0100),
        (Space::HostMot2, 0x0400),
        (Space::Timer, 0x10),
        (Space::Control, 0x0A),
        (Space::ReadOnly, 0),
        (Space::Eeprom, 0x7E),
    ] {
        assert_eq!(read(bus, space, address), Ok(()), "{space} {address:#x}");
    }
}

#[test]
fn packets_are_few_small_and_never_two_in_flight() {
    let machine = machine();
    let mut bus = look(&machine);
    bus.identify().expect("a 7I97");
    // Lost, and 0.1 s late: more than an interval.
    bus.link().fates = [None, Some(0), Some(100_000_000), Some(0), None, None].into();
    let map = bus.map().expect("identified").clone();
    let reads: Vec<_> = map
        .readable()
        .map(|r| Read::hostmot2(r.address, 1))
        .collect();
    for _ in 0..10 {
        bus.read_all(&reads).expect("a board");
    }
    assert_eq!(bus.packets().lost, 3);
    let link = bus.link();
    let times = link.sent.iter().map(|(at, _)| *at).collect::<Vec<_>>();
    assert!(times.len() >= 20, "{}", times.len());
    for pair in times.windows(2) {
        assert!(pair[1] - pair[0] >= 50_000_000, "{} ns", pair[1] - pair[0]);
    }
    let longest = link.sent.iter().map(|(_, packet)| packet.len()).max();
    let longest = longest.max(link.lengths.iter().copied().max());
    assert!(longest <= Some(280), "{longest:?} bytes");
}

/// The count of an encoder that turns: an older reply has another one.
#[test]
fn late_reply_is_not_taken_for_a_newer_one() {
    let machine = machine();
    let mut bus = look(&machine);
    bus.identify().expect("a 7I97");
    let turn = |machine: &Rc<RefCell<Machine>>| {
        let mut machine = machine.borrow_mut();
        let fpga = machine.driver.bus_mut().link().board.gateware_mut();
        fpga.motor(0).expect("a motor").turn_by_hand(Some(50.0));
    };
    turn(&machine);
    let mut before = bus.read(COUNT).expect("a board") as u16;
    // The first reply arrives after the next request, and so does each of the others.
    bus.link().fates = [Some(230_000_000), Some(0), Some(230_000_000), Some(0)].into();
    for _ in 0..6 {
        let asked = bus.link().time();
        let found = bus.read(COUNT).expect("a board") as u16;
        let waited = bus.link().time() - asked;
        let moved = found.wrapping_sub(before);
        assert!(
            (1..30_000).contains(&moved),
            "{moved} counts in {waited} ns"
        );
        before = found;
    }
    assert_eq!(bus.packets().lost, 2);
}

#[test]
fn no_answer_is_an_error_with_advice_after_three_tries() {
    let machine = machine();
    let mut bus = look(&machine);
    bus.link().fates = [None; 3].into();
    let error = bus.read(0x0100).expect_err("no answer");
    assert_eq!(error.kind(), BusErrorKind::Lost);
    assert!(
        error.to_string().contains("no reply in time in 3 tries"),
        "{error}"
    );
    assert!(error.advice().is_some());
    assert_eq!(bus.read(0x0100), Ok(0x55AA_CAFE));
}

/// The value of a sample with this name.
fn value(sample: &Sample, name: &str) -> Option<AnyValue> {
    let mut values = sample.values.iter();
    values
        .find(|value| value.name == name)
        .map(|value| value.value)
}

/// Each value is the one that the driver has for the pin of the same name, of inputs as of outputs.
#[test]
fn values_of_a_running_machine_are_those_of_its_driver() {
    let machine = machine();
    {
        let mut machine = machine.borrow_mut();
        let pins = machine.driver.pins_mut();
        for (name, on) in [("ssr.00.out-03", true), ("pwmgen.02.enable", true)] {
            let pin = pins.output::<bool>(&format!("hm2_7i97.0.{name}"));
            pins.set(pin.expect("an output"), on);
        }
    }
    let mut watched = Watched::new(look(&machine)).expect("a 7I97");
    let sample = watched.sample().expect("a board");
    let machine = machine.borrow();
    let pins = machine.driver.pins();
    let mut compared = 0;
    for shown in &sample.values {
        let Some(pin) = pins.find(&shown.name) else {
            continue;
        };
        let reading = pins.read_any(pin);
        assert_eq!(
            (shown.value, true),
            (reading.value, reading.valid),
            "{}",
            shown.name
        );
        compared += 1;
    }
    assert!(compared > 100, "{compared} pins");
    for name in ["ssr.00.out-03", "pwmgen.02.enable", "inmux.00.input-15-not"] {
        let name = format!("hm2_7i97.0.{name}");
        assert_eq!(value(&sample, &name), Some(true.into()), "{name}");
    }
    let bitten = value(&sample, "hm2_7i97.0.watchdog.has_bit");
    assert_eq!(bitten, Some(false.into()));
    // What depends on counts or parameters of the driver has no value.
    for name in ["encoder.00.count", "encoder.00.position", "pwmgen.00.value"] {
        assert_eq!(
            value(&sample, &format!("hm2_7i97.0.{name}")),
            None,
            "{name}"
        );
    }
    let channel = sample
        .values
        .iter()
        .find(|value| value.name == "sserial.0.0.cs");
    let state = channel.and_then(|channel| channel.text.as_deref());
    assert!(
        state.is_some_and(|state| state.starts_with("running")),
        "{state:?}"
    );
    let mut places = sample.values.iter().map(|value| &value.place);
    assert!(places.any(|place| place.contains("TB")), "terminals");
}

/// A bite, and a board that does not answer any more.
#[test]
fn bite_is_shown_and_values_are_gone_without_an_answer() {
    let machine = machine();
    let mut watched = Watched::new(look(&machine)).expect("a 7I97");
    {
        let mut machine = machine.borrow_mut();
        let bitten_by = machine.driver.bus_mut();
        bitten_by.wait(Duration::from_millis(100));
    }
    let sample = watched.sample().expect("a board");
    let bitten = value(&sample, "hm2_7i97.0.watchdog.has_bit");
    assert_eq!(bitten, Some(true.into()));
    watched.bus().link().fates = [None; 3].into();
    let error = watched.sample().expect_err("no answer");
    assert_eq!(error.kind(), BusErrorKind::Lost);
    assert_eq!(watched.listener().shown().count(), 0);
    assert!(watched.sample().is_ok());
}
