//! The registrations of the built-in modules on the firmwares of FACTS 9.2 and 9.3.

use crate::events::EventSink;
use alloc::{boxed::Box, string::ToString, vec::Vec};
use core::any::Any;

use super::dpll::Dpll;
use super::encoder::Encoders;
use super::in_mux::InMux;
use super::outputs::Outputs;
use super::pwm::Pwm;
use super::undriven::{UndrivenReason, undriven};
use super::{Module, RegisterError, Registrar, built_in};
use crate::advice::{self, MesaError};
use crate::boards::BoardTable;
use crate::bus::{ImagePlan, RegisterBus};
use crate::hal::{GroupId, PinStore};
use crate::hostmot2::{Gtag, HostMot2, IoPorts, TickRate};
use crate::settings::{Defaults, Settings};
use crate::sslbp::PortLayout;
use mesa_hal_sim::{SimFirmware, SimFpga, SimModuleDescriptor, SimPinDescriptor, gtag, machines};

/// The environment that a module registers with.
struct Bench {
    fpga: SimFpga,
    firmware: HostMot2,
    settings: Settings,
    pins: PinStore,
    group: GroupId,
    io: IoPorts,
    plan: ImagePlan,
}

impl Bench {
    fn new(firmware: SimFirmware) -> Self {
        let mut fpga = SimFpga::new(firmware);
        let firmware = HostMot2::identify(&mut fpga).unwrap();
        let mut pins = PinStore::default();
        Self {
            fpga,
            settings: Settings::default(),
            group: pins.add_group(),
            pins,
            io: IoPorts::locate(&firmware).unwrap(),
            plan: ImagePlan::default(),
            firmware,
        }
    }

    /// The modules that `register` adds, which are of one kind.
    fn register<M: Module>(
        &mut self,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<(), RegisterError>,
    ) -> Result<Vec<M>, RegisterError> {
        let mut added = Vec::new();
        self.with_registrar(&mut added, register)?;
        let modules = added.into_iter().map(|module| {
            let module: Box<dyn Any> = module;
            *module.downcast().unwrap()
        });
        Ok(modules.collect())
    }

    fn with_registrar<T>(
        &mut self,
        added: &mut Vec<Box<dyn Module>>,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<T, RegisterError>,
    ) -> Result<T, RegisterError> {
        let mut peek = |address| Ok(self.fpga.read(address).unwrap());
        register(&mut Registrar {
            firmware: &self.firmware,
            board: BoardTable::for_firmware(&self.firmware, &[]),
            name: "hm2_7i97.0",
            settings: &self.settings,
            group: self.group,
            status: self.group,
            pins: &mut self.pins,
            events: &EventSink::new("", 1),
            io: &mut self.io,
            image: &mut self.plan,
            added,
            claimed: &mut Vec::new(),
            is_driven: |module| built_in::check(module).is_ok(),
            bus: &mut peek,
        })
    }

    /// The writes of the set-up to registers from `from` on, in order.
    fn set_up(&self, from: u16, to: u16) -> Vec<(u16, u32)> {
        let all = self.plan.first_set_up().into_iter();
        all.filter(|(address, _)| (from..to).contains(address))
            .collect()
    }

    /// The directions that the modules give their pins.
    fn outputs(&self) -> Vec<u32> {
        let setups = self.io.ports.iter().map(|port| port.setup);
        assert!(
            setups
                .clone()
                .all(|setup| setup.direction == setup.alternate_source)
        );
        setups.map(|setup| setup.direction).collect()
    }
}

fn i7i97() -> Bench {
    Bench::new(machines::firmware_7i97(1))
}

/// ClockLow/16, microseconds, and the short filter. The counts are not written: they run on.
#[test]
fn encoders_are_set_up_at_the_rate_of_their_board() {
    let mut bench = i7i97();
    let encoders = bench
        .register::<Encoders>(Encoders::register)
        .unwrap()
        .remove(0);
    assert_eq!(encoders.pins().len(), 6);
    let words = bench.set_up(0x3600, 0x4100);
    assert_eq!(words[..2], [(0x3800, 98), (0x3A00, 14)]);
    let modes = [0x3700, 0x3704, 0x3708, 0x370C, 0x3710, 0x3714];
    assert_eq!(words[2..8], modes.map(|address| (address, 0)));
    // The source that latches the counts: a timer of the DPLL.
    assert_eq!(words[8..], [(0x3B00, 0)]);
    assert_eq!(bench.outputs(), [0, 1 << 1, 0], "the select line");
}

/// 8 MHz divided from 100 MHz, and the filter over 15 samples.
#[test]
fn encoders_are_set_up_with_the_values_of_linuxcnc_on_request() {
    let mut bench = i7i97();
    let mode = |bench: &Bench| bench.set_up(0x3700, 0x3704)[0].1;
    bench.register::<Encoders>(Encoders::register).unwrap();
    assert_eq!(mode(&bench), 0);
    let mut bench = i7i97();
    bench.settings.defaults = Defaults::LinuxCnc;
    bench.register::<Encoders>(Encoders::register).unwrap();
    assert_eq!(bench.set_up(0x3A00, 0x3A04), [(0x3A00, 10)]);
    assert_eq!(mode(&bench), 1 << 11);
}

#[test]
fn encoders_have_the_pins_and_the_select_lines_of_their_cards() {
    let mut bench = Bench::new(machines::firmware_7i92_7i77x2());
    bench.settings = Settings {
        instances: [(Gtag::ENCODER, 7)].into(),
        ..Settings::default()
    };
    let encoders = bench
        .register::<Encoders>(Encoders::register)
        .unwrap()
        .remove(0);
    assert_eq!(encoders.pins().len(), 7);
    // EncMux: FACTS 8.1, 12.7.
    assert_eq!(bench.outputs(), [1 << 7, 1 << 7]);
    assert_eq!(bench.set_up(0x3A00, 0x3A04), [(0x3A00, 6)], "ClockLow/8");
}

#[test]
fn encoder_rate_beyond_its_register_is_refused() {
    let mut bench = i7i97();
    bench.settings.encoder_rate = Some(TickRate(0x1000));
    let error = bench.register::<Encoders>(Encoders::register).unwrap_err();
    assert_eq!(error.advice(), Some(advice::SET_ENCODER_RATE));
    assert_eq!(
        error.to_string(),
        "rate of the encoders: TickRate(4096), expected at most TickRate(4095): the register has 12 \
         bits"
    );
}

/// The set-up ends at rest: the mode without double buffering, the value, the mode.
#[test]
fn pwm_generators_are_at_rest_at_the_end_of_their_set_up() {
    let mut bench = i7i97();
    let pwm = bench.register::<Pwm>(Pwm::register).unwrap().remove(0);
    assert_eq!(pwm.pins().len(), 6);
    let words = bench.set_up(0x4100, 0x5000);
    // 48 kHz; 20 kHz of PDM.
    assert_eq!(words[..3], [(0x4500, 0), (0x4300, 64_425), (0x4400, 7)]);
    for (n, generator) in (0..).zip(words[3..].chunks(3)) {
        let (value, mode) = (0x4100 + 4 * n, 0x4200 + 4 * n);
        assert_eq!(
            generator,
            [(mode, 0x03), (value, 0x0800_0000), (mode, 0x23)]
        );
    }
    assert_eq!(words.len(), 3 + 18);
    // Outputs 0 to 5, and three enables.
    assert_eq!(bench.outputs(), [0x1FF, 0, 0]);
}

#[test]
fn relays_have_no_drive_before_their_pins_are_driven() {
    let mut bench = i7i97();
    let outputs = bench.register::<Outputs>(Outputs::register).unwrap();
    assert_eq!(outputs[0].outputs().len(), 6);
    let words = bench.set_up(0x7D00, 0x7F00);
    assert_eq!(words, [(0x7D00, 0), (0x7E00, 0), (0x7E00, 0x1030)]);
    // Six outputs and the reference.
    assert_eq!(bench.outputs(), [0, 0x7F << 2, 0]);
}

#[test]
fn input_scans_and_dpll_are_set_up_from_hardware_data() {
    let mut bench = i7i97();
    let inputs = bench.register::<InMux>(InMux::register).unwrap();
    assert_eq!(inputs[0].pins.inputs.len(), 16);
    let control = 15 | 1 << 5 | 77 << 6 | 5 << 16 | 500 << 22;
    let expected = [(0x8000, control), (0x8100, 0), (0x8400, 0)];
    assert_eq!(bench.set_up(0x8000, 0x9000), expected);
    assert_eq!(bench.register::<Dpll>(Dpll::register).unwrap().len(), 1);
    let words = bench.set_up(0x7000, 0x7700);
    // 1 kHz with 42 bits; 100 us after the read.
    assert_eq!(words[..2], [(0x7000, 1_055_531_162), (0x7200, 0x1840_0000)]);
    assert_eq!(
        words[2..],
        [
            (0x7300, 2000 << 16),
            (0x7400, 0xE667_E667),
            (0x7500, 0xE667_E667)
        ]
    );
}

#[test]
fn addresses_follow_the_descriptor_and_not_the_usual_place() {
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(gtag::PWM).unwrap().base = 0x9000;
    let mut bench = Bench::new(firmware);
    bench.register::<Pwm>(Pwm::register).unwrap();
    assert_eq!(bench.set_up(0x4100, 0x5000), []);
    assert_eq!(bench.set_up(0x9000, 0x9500)[0], (0x9400, 0));
}

#[test]
fn each_instance_of_outm_has_its_register() {
    let mut firmware = machines::firmware_7i97(1);
    let out_m = SimModuleDescriptor {
        gtag: gtag::OUT_M,
        instances: 2,
        base: 0xB000,
        registers: 1,
        multiple: 1,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(out_m);
    for (instance, pin) in [(0, 40), (1, 41)] {
        firmware.pins[pin] = SimPinDescriptor::new(gtag::OUT_M, instance, 0x81);
    }
    let mut bench = Bench::new(firmware);
    let outputs = bench.register::<Outputs>(Outputs::register).unwrap();
    assert_eq!(outputs.len(), 3, "one of SSR");
    assert_eq!(bench.set_up(0xB000, 0xB100), [(0xB000, 0), (0xB004, 0)]);
}

#[test]
fn absent_or_unknown_modules_are_skipped_and_unknown_ones_named() {
    // A descriptor without instances counts as missing too.
    let mut bench = Bench::new(machines::firmware_7i92_7i77());
    assert!(bench.register::<Pwm>(Pwm::register).unwrap().is_empty());
    let mut bench = Bench::new(machines::firmware_7i92_7i77x2());
    assert!(bench.register::<Pwm>(Pwm::register).unwrap().is_empty());
    assert!(bench.register::<Dpll>(Dpll::register).unwrap().is_empty());
    assert!(bench.register::<InMux>(InMux::register).unwrap().is_empty());
    assert!(
        bench
            .register::<Outputs>(Outputs::register)
            .unwrap()
            .is_empty()
    );

    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(gtag::MUXED_ENCODER).unwrap().version = 5;
    firmware.module_mut(gtag::PWM).unwrap().multiple = 7;
    let mut bench = Bench::new(firmware);
    assert!(
        bench
            .register::<Encoders>(Encoders::register)
            .unwrap()
            .is_empty()
    );
    assert!(bench.register::<Pwm>(Pwm::register).unwrap().is_empty());
    assert_eq!(bench.outputs(), [0, 0, 0]);
    let list = undriven(&bench.firmware, &[]);
    let advice: Vec<_> = list.iter().map(|module| module.reason.advice()).collect();
    let known = Some(advice::USE_KNOWN_FIRMWARE);
    assert_eq!(advice, [known, None, known]);
    let texts: Vec<_> = list.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "MuxedEncoder (0C) version 5, 6 instances: MuxedEncoder (0C) has version 5, expected 2 to 4; \
             I/O pins 9-17 are plain I/O",
            "MuxSelect (0D) version 0, 1 instance: no multiplexed encoder is driven; I/O pin 18 is plain \
             I/O",
            "PWM (06) version 0, 6 instances: PWM (06) has 5 registers with multiple-register mask 0x7 \
             (version 0), expected at least 5 and 0x3; I/O pins 0-8 are plain I/O",
        ]
    );
    let claimed = undriven(&bench.firmware, &[Gtag::PWM, Gtag::MUXED_ENCODER]);
    let left: Vec<_> = claimed.iter().map(|module| module.gtag).collect();
    assert_eq!(left, [Gtag::MUX_SELECT]);
}

/// Two modules of a kind in one firmware, and both kinds of encoders.
fn doubled() -> Bench {
    let mut firmware = machines::firmware_7i97(1);
    let plain = SimModuleDescriptor {
        gtag: gtag::ENCODER,
        version: 3,
        instances: 2,
        base: 0x3000,
        registers: 5,
        multiple: 3,
        ..SimModuleDescriptor::default()
    };
    let more_pwm = SimModuleDescriptor {
        gtag: gtag::PWM,
        clock: 2,
        instances: 2,
        base: 0x9000,
        registers: 5,
        multiple: 3,
        ..SimModuleDescriptor::default()
    };
    let wide = SimModuleDescriptor {
        gtag: gtag::SSERIAL_B,
        base: 0xA000,
        registers: 10,
        strides: 0x10,
        multiple: 0x3FC,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.extend([plain, more_pwm, wide]);
    for (pin, (kind, unit, number)) in [
        (gtag::ENCODER, 0, 1),
        (gtag::ENCODER, 1, 1),
        (gtag::PWM, 6, 0x81),
        (gtag::PWM, 7, 0x81),
        (gtag::SSERIAL_B, 0, 1),
        (gtag::SSERIAL_B, 0, 0x81),
    ]
    .into_iter()
    .enumerate()
    {
        firmware.pins[40 + pin] = SimPinDescriptor::new(kind, unit, number);
    }
    Bench::new(firmware)
}

#[test]
fn instances_of_two_modules_of_a_kind_are_numbered_through() {
    let mut bench = doubled();
    let encoders = bench.register::<Encoders>(Encoders::register).unwrap();
    let pwm = bench.register::<Pwm>(Pwm::register).unwrap();
    let counts: Vec<_> = encoders.iter().map(|bank| bank.pins().len()).collect();
    assert_eq!(counts, [6, 2], "muxed, which come first, and plain");
    assert_eq!(pwm.iter().map(|bank| bank.pins().len()).sum::<usize>(), 8);
    let names: Vec<_> = bench
        .pins
        .infos()
        .iter()
        .map(|info| info.name.as_str())
        .collect();
    for name in [
        "encoder.05.count",
        "encoder.06.count",
        "encoder.07.count",
        "encoder.muxed-sample-frequency",
        "encoder.bank-1.sample-frequency",
        "encoder.bank-1.timer-number",
        "pwmgen.05.value",
        "pwmgen.07.value",
        "pwmgen.pwm_frequency",
        "pwmgen.bank-1.pwm_frequency",
    ] {
        assert!(
            names.contains(&&*alloc::format!("hm2_7i97.0.{name}")),
            "{name}"
        );
    }
    // The second instance of the second module: mode and value.
    let (set_up, both) = (bench.set_up(0x9000, 0x9200), [0x9104, 0x9004]);
    assert!(
        both.iter()
            .all(|at| set_up.iter().any(|(address, _)| address == at))
    );
    assert_eq!(bench.set_up(0x3104, 0x3108).len(), 1);
    // Outputs of both: pins 42 and 43 are bits 8 and 9 of the third port.
    assert_eq!(bench.outputs()[2], 0b11 << 8);
    assert_eq!(undriven(&bench.firmware, &[]), []);
    let ports = PortLayout::ports(&bench.firmware);
    let ports = ports
        .iter()
        .map(|port| (port.gtag, port.layout.instance, port.layout.command));
    let expected = [(Gtag::SSERIAL, 0, 0x5B00), (Gtag::SSERIAL_B, 1, 0xA000)];
    assert_eq!(ports.collect::<Vec<_>>(), expected);
}

#[test]
fn second_of_what_there_is_one_for_all_is_not_driven() {
    let mut firmware = machines::firmware_7i97(1);
    let dpll = SimModuleDescriptor {
        gtag: gtag::DPLL,
        base: 0x7800,
        registers: 7,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(dpll);
    let mut bench = Bench::new(firmware);
    assert_eq!(bench.register::<Dpll>(Dpll::register).unwrap().len(), 1);
    assert_eq!(bench.set_up(0x7800, 0x7D00), []);
    let list = undriven(&bench.firmware, &[]);
    assert_eq!(list.len(), 1);
    assert_eq!(list[0].reason, UndrivenReason::Another);
}

#[test]
fn io_pin_has_one_user() {
    let mut bench = i7i97();
    bench.register::<Pwm>(Pwm::register).unwrap();
    let again = bench.with_registrar(&mut Vec::new(), |r| r.use_io(Gtag::PWM, 3));
    let again = again.unwrap_err();
    assert_eq!(
        again.to_string(),
        "I/O pin 3 is used by a module or as plain I/O already"
    );
    assert_eq!(again.advice(), Some(advice::CHOOSE_OTHER_PIN));
    // An instance without pins is accepted all the same: its pins may be local I/O.
    let without_pins = bench.with_registrar(&mut Vec::new(), |r| r.use_io(Gtag::SSR, 1));
    without_pins.unwrap();
}
