//! A configuration that cannot run is refused at the start, with the missing part, and everything
//! is stopped.

use std::time::Duration;

use crate::common::machine::{OUTPUTS, fpga, start};
use mesa_hal::Settings;
use mesa_hal::bus::{Access, AccessList, Clock, Hold, Instant, RegisterBus, Reply};
use mesa_hal::bus::{BusError, Phase};
use mesa_hal::discovery::RemoteTable;
use mesa_hal::driver::{
    Board, Driver, DriverError, Presence, RemarkKind, RemoteConfig, SerialConfig,
};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::{Module, Registrar};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::{SimFpga, gtag, machines};

#[test]
fn missing_or_wrong_required_remote_fails_the_build() {
    const OTHER: RemoteTable = RemoteTable::new("other card", *b"7I84", &[]);
    let build = |remote: RemoteConfig, fpga: &mut SimFpga| {
        let mut config = SerialConfig::default();
        config.channels.insert(2, remote);
        let result = start(&mut *fpga, |s| s.serial_ports = [(0, config)].into());
        let Err(DriverError::Missing(missing)) = result else {
            panic!("built");
        };
        missing.kind
    };
    let any = RemoteConfig {
        presence: Presence::Required,
        ..RemoteConfig::default()
    };
    let (kind, unit_number) = (Some(&OTHER), Some(1));
    let mut simulated = fpga();
    let wrong = build(RemoteConfig { kind, ..any }, &mut simulated);
    assert!(matches!(wrong, RemarkKind::WrongRemote(_)), "{wrong}");
    let wrong = build(RemoteConfig { unit_number, ..any }, &mut simulated);
    assert!(matches!(wrong, RemarkKind::WrongRemote(_)), "{wrong}");
    let wrong = build(RemoteConfig { mode: 7, ..any }, &mut simulated);
    assert!(
        matches!(wrong, RemarkKind::Tables(_))
            && wrong.to_string().contains("software mode 7 is not one of"),
        "{wrong}"
    );
    simulated.plug(0, OUTPUTS, None);
    let wrong = build(any, &mut simulated);
    assert!(matches!(wrong, RemarkKind::DidNotStart(_)), "{wrong}");
    assert_eq!(
        simulated.read_register(0x5D00) & 0xFFFF,
        0xC100,
        "the others are stopped"
    );
}

/// Directions that the board reads back are evidence, which is only known when all modules have
/// registered: with no serial port, nothing registers after this one.
#[test]
fn module_reading_directions_as_data_is_refused_with_register() {
    #[derive(Debug)]
    struct Curious;

    impl Module for Curious {}

    let mut firmware = machines::firmware_7i97(1);
    firmware
        .modules
        .retain(|module| module.gtag != gtag::SSERIAL);
    let fpga = SimFpga::new(firmware);
    let mut board = Board::identify(fpga, Settings::default()).expect("a 7I97");
    let register = |r: &mut Registrar<'_>| {
        let ports = r.module(Gtag::IO_PORT).expect("I/O ports");
        r.image.read(Phase::Data, ports.register(1, 0)?);
        r.add(Curious);
        Ok(())
    };
    board.add(register).expect("the register is free");
    let error = board.start().map(drop).expect_err("two phases");
    assert!(error.to_string().contains("read in two phases"), "{error}");
    assert_eq!(error.advice(), Some(advice::LEAVE_MODULE_OUT));
}

#[test]
fn period_that_is_too_short_is_refused_with_the_time_it_needs() {
    let mut simulated = fpga();
    let period = Duration::from_micros(50);
    let result = start(&mut simulated, |s| s.period = period);
    let Err(DriverError::PeriodTooShort { needed, .. }) = result else {
        panic!("built");
    };
    assert!(needed > period && needed < 2 * period, "{needed:?}");
}

/// A bus that accepts no list of the cycle, as one whose packets are too small.
#[derive(Debug)]
struct TooSmall(SimFpga);

impl RegisterBus for &mut TooSmall {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        self.0.exchange(accesses, words)
    }

    fn prepare(&mut self, _: &[Access], _: Option<Hold>) -> Result<AccessList, BusError> {
        Err(BusError::TooLong {
            what: "request",
            bytes: 2,
            limit: 1,
        })
    }

    fn finish(&mut self, _: &AccessList, _: &mut [u32]) -> Result<Reply, BusError> {
        panic!("there is no list")
    }
}

impl Clock for &mut TooSmall {
    fn now(&mut self) -> Instant {
        Clock::now(&mut self.0)
    }

    fn wait(&mut self, duration: Duration) {
        self.0.wait(duration);
    }
}

#[test]
fn bus_refusing_the_cycle_fails_the_start_and_stops_remotes() {
    let mut bus = TooSmall(fpga());
    let error = Driver::start(&mut bus, Settings::default()).unwrap_err();
    assert!(matches!(error, DriverError::Bus(_)), "{error}");
    for channel in 0..3u16 {
        let cs = bus.0.read_register(0x5D00 + 4 * channel);
        assert_eq!(cs & 0xFFFF, 0xC100, "channel {channel}");
    }
    assert_eq!(bus.0.read_register(0x1100), 0, "all pins are inputs");
}

#[test]
fn invalid_settings_are_refused_with_the_allowed_values() {
    let mut settings = [(); 2].map(|()| Settings::default());
    settings[0].bus_error_limit = 0;
    settings[1].watchdog = Some(Duration::from_secs(3600));
    let said = ["at least 1", "at most 4.29 s"];
    for (settings, said) in settings.into_iter().zip(said) {
        let error = Driver::start(fpga(), settings).expect_err(said);
        assert!(error.to_string().contains(said), "{error}");
        assert!(error.advice().is_some(), "{error}");
    }
}

#[test]
fn restart_of_a_channel_without_a_remote_returns_false() {
    let mut driver = start(fpga(), |_| {}).expect("it runs");
    assert!(driver.restart((0, OUTPUTS as u8)));
    for (port, channel) in [(0, 7), (0, 200), (7, 0)] {
        assert!(!driver.restart((port, channel)), "{port}.{channel}");
    }
}
