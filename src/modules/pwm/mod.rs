//! PWM and PDM generators: analog outputs.
//!
//! Source: FACTS 13.5, 9.5, 12.3.

mod duty;

use alloc::format;
use alloc::vec::Vec;

use super::limit::Limit;
use super::registrar::DrivenModule;
use super::{ListenCycle, Module, RegisterError, Registrar, WriteCycle, bank_stem, bits_of};
use crate::events::CorrectedValue;
use crate::settings::Defaults;

pub use duty::{PwmRate, PwmShape};

use duty::{DITHER_BITS, DOUBLE_BUFFERED, PDM, fastest_pdm, pdm_word};

use crate::advice;
use crate::bus::{ReadSlot, Setting, Stage, WriteSlot};
use crate::hal::{FullScale, Output, Param, PinStore, Spec, Terminals};
use crate::hostmot2::board_table::PwmTable;
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor};

/// The pins of one generator: `hm2_7i97.0.pwmgen.00.value` and so on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PwmPins {
    /// The value; full scale is `scale`.
    pub value: Output<f64>,
    /// While false, the output is zero (half scale in offset mode) whatever `value` is, and the
    /// generator's enable output is off, if it has one: the hardware's own enable does not affect
    /// the PWM (FACTS 12.3).
    pub enable: Output<bool>,
    /// 0 is half scale on the wire: for analog outputs of both signs. Initially true for the
    /// generators that drive analog outputs on the board, and false for all others, and with
    /// [`Defaults::LinuxCnc`].
    pub offset_mode: Param<bool>,
    /// The value at full scale.
    pub scale: Param<f64>,
    /// 1: PWM on the first pin and direction on the second; 2: PWM on the first pin for positive,
    /// on the second for negative values; 3: pulse density and direction, with 12 bits; 4:
    /// direction and PWM. Any other value becomes 1, with an event.
    pub output_type: Param<i32>,
    /// Uses the fraction of the duty: the output changes between two adjacent widths, with an
    /// average between them. Only with module version 1. Initially true, and false with
    /// [`Defaults::LinuxCnc`].
    pub dither: Option<Param<bool>>,
}

/// All PWM generators.
#[derive(Debug)]
pub struct Pwm {
    /// PWM frequency of all generators in Hz.
    pub pwm_frequency: Param<u32>,
    /// Frequency of the PDM clock of all generators in Hz, each tick of which is one step of 4096;
    /// as in LinuxCNC.
    pub pdm_frequency: Param<u32>,
    generators: Vec<PwmGenerator>,
    /// The number of the module among those of its kind.
    bank: u32,
    clock_hz: u32,
    /// The last requested frequencies, of PWM and PDM.
    hz: (u32, u32),
    /// The rate in the hardware for the requested PWM frequency.
    rate: PwmRate,
    master_rate: Setting,
    pdm_rate: Setting,
    /// Bit n is generator n; 1 drives the enable pin low. The bits do not affect the PWM
    /// (FACTS 12.3).
    enables: WriteSlot,
    /// Those that another program has set.
    enabled: ReadSlot,
}

#[derive(Debug)]
struct PwmGenerator {
    pins: PwmPins,
    /// The number in its names.
    number: u8,
    /// Bit mask of the generators that must be enabled for this one to run.
    enabled_by: u32,
    /// The shape that was written last.
    shape: PwmShape,
    value: WriteSlot,
    mode: Setting,
}

impl Pwm {
    /// The pins of each generator.
    pub fn pins(&self) -> impl ExactSizeIterator<Item = PwmPins> + '_ {
        self.generators.iter().map(|generator| generator.pins)
    }

    /// Registers the generators of each PWM module of a firmware: version 0, or 1, which dithers.
    /// They are at rest at the end of the set-up, without waiting for the end of a period.
    ///
    /// Generators of several modules are numbered consecutively. The shared pins of a second module
    /// are named `pwmgen.bank-1.pwm_frequency`, and so on.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        let modules = r.driven(&[Gtag::PWM]);
        let all = modules
            .last()
            .map_or(0, |last| last.number(last.descriptor.instances));
        let beyond = r.settings.pwm.keys().find(|&&n| n >= all);
        if let Some(beyond) = beyond.filter(|_| all > 0) {
            return Err(RegisterError::Setting {
                what: "a PWM generator",
                found: format!("{beyond}"),
                expected: format!("less than {all}, the generators of this firmware"),
                advice: advice::SET_PWM,
            });
        }
        for (bank, module) in modules.iter().enumerate() {
            let module = Self::new(r, module, bank)?;
            r.add(module);
        }
        register_without_generators(r)
    }

    fn new(
        r: &mut Registrar<'_>,
        of_kind: &DrivenModule,
        bank: usize,
    ) -> Result<Self, RegisterError> {
        let module = &of_kind.descriptor;
        let (clock_hz, dithers) = (module.clock_hz, module.version >= 1);
        let usual = usual_hz(initial(r, &r.board.pwm), clock_hz, dithers);
        let hz = (r.settings.pwm_hz.unwrap_or(usual), 20_000);
        let fastest = PwmRate::fastest(clock_hz);
        if !(1..=fastest).contains(&hz.0) {
            return Err(RegisterError::Setting {
                what: "PWM frequency",
                found: format!("{} Hz", hz.0),
                expected: format!("1 to {fastest} Hz, which this firmware's clock allows"),
                advice: advice::SET_PWM_FREQUENCY,
            });
        }
        let mut make = r.maker(&bank_stem("pwmgen", bank));
        let pwm_frequency = make.setting("pwm_frequency", hz.0)?;
        let pdm_frequency = make.setting("pdm_frequency", hz.1)?;
        let rate = PwmRate::new(clock_hz, hz.0.into());
        let (master_rate, pdm_rate) = (module.register(2, 0)?, module.register(3, 0)?);
        let enables_address = module.register(4, 0)?;
        let enables = r.image.output(enables_address, 0);
        let enabled = r.image.read_back(enables_address);
        let master_rate = r
            .image
            .setting(Stage::Configure, master_rate, rate.rate.into());
        let pdm_rate = r
            .image
            .setting(Stage::Configure, pdm_rate, pdm_word(clock_hz, hz.1).into());
        debug_assert!(u32::try_from(bank).is_ok(), "bank {bank}");
        let generators = (0..module.instances)
            .map(|instance| PwmGenerator::new(r, of_kind, instance, rate.bits))
            .collect::<Result<Vec<_>, _>>()?;
        link_enables(r, of_kind, &generators);
        Ok(Self {
            pwm_frequency,
            pdm_frequency,
            generators,
            bank: u32::try_from(bank).unwrap_or(0),
            clock_hz,
            hz,
            rate,
            master_rate,
            pdm_rate,
            enables,
            enabled,
        })
    }

    fn write_rates(&mut self, cycle: &mut WriteCycle<'_>) {
        let limit = |setting, highest: u32| Limit {
            setting,
            number: self.bank,
            lowest: 1,
            highest: highest.into(),
            instead: None,
        };
        let [pwm, pdm] = [PwmRate::fastest(self.clock_hz), fastest_pdm(self.clock_hz)];
        let hz = (
            limit(CorrectedValue::PwmFrequency, pwm).param(cycle, self.pwm_frequency),
            limit(CorrectedValue::PdmFrequency, pdm).param(cycle, self.pdm_frequency),
        );
        if hz != self.hz {
            self.hz = hz;
            self.rate = PwmRate::new(self.clock_hz, hz.0.into());
            cycle.words.set(self.master_rate, self.rate.rate.into());
            cycle
                .words
                .set(self.pdm_rate, pdm_word(self.clock_hz, hz.1).into());
        }
    }
}

/// Makes the frequencies that LinuxCNC's driver makes for a descriptor without instances, as stock
/// firmwares of the 7I92 have it, so that HAL files which set them load. They set nothing.
fn register_without_generators(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
    let mut modules = r.firmware.modules.iter();
    let is_named = modules.any(|module| module.gtag == Gtag::PWM);
    let is_wanted = r.settings.instances.get(&Gtag::PWM) != Some(&0);
    let has_generators = r.firmware.find(Gtag::PWM).is_some();
    if r.settings.defaults != Defaults::LinuxCnc || !is_named || !is_wanted || has_generators {
        return Ok(());
    }
    let mut make = r.maker(&bank_stem("pwmgen", 0));
    for name in ["pwm_frequency", "pdm_frequency"] {
        make.setting(name, 20_000_u32)?;
    }
    Ok(())
}

/// The table of the initial values: that of the board, or LinuxCNC's.
fn initial<'a>(r: &Registrar<'_>, board: &'a PwmTable) -> &'a PwmTable {
    match r.settings.defaults {
        Defaults::Board => board,
        Defaults::LinuxCnc => &PwmTable::PLAIN,
    }
}

/// The frequency of a table; of those for dithering, the first that keeps enough bits.
fn usual_hz(table: &PwmTable, clock_hz: u32, dithers: bool) -> u32 {
    if !dithers {
        return table.hz;
    }
    let keeps = |hz: &&u32| PwmRate::new(clock_hz, f64::from(**hz)).bits >= DITHER_BITS;
    let offered = table.hz_dither;
    let usual = offered.iter().find(keeps).or(offered.last());
    usual.copied().unwrap_or(table.hz)
}

/// Links each value to its enable, and each enable to that of its leader.
fn link_enables(r: &mut Registrar<'_>, of_kind: &DrivenModule, generators: &[PwmGenerator]) {
    for (number, PwmGenerator { pins, .. }) in (of_kind.first..).zip(generators) {
        r.pins.enabled_by(pins.value, pins.enable);
        let leader = of_kind.leader(r, number);
        let leader = leader.and_then(|leader| generators.get(usize::from(leader)));
        if let Some(leader) = leader {
            r.pins.enabled_by(pins.enable, leader.pins.enable);
        }
    }
}

/// Checks layout and version: 0 or 1. The enable register has 32 bits, one for each generator.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    const MAX: u8 = 32;
    module.check_layout(5, 0x3)?;
    module.expect_version(module.version, 0..=1)?;
    if module.instances <= MAX {
        return Ok(());
    }
    Err(HostMot2Error::Unknown {
        gtag: module.gtag,
        found: format!("{} instances", module.instances),
        expected: format!("at most {MAX}"),
    })
}

impl DrivenModule {
    /// The instance of this module whose enable output also switches the drive of generator
    /// `number`, if there is one.
    fn leader(&self, r: &Registrar<'_>, number: u8) -> Option<u8> {
        let leader = r.board.pwm.switched_by(number)?;
        let instance = leader.checked_sub(self.first)?;
        (instance < self.descriptor.instances).then_some(instance)
    }
}

impl Module for Pwm {
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        let enables = cycle.words.word(self.enabled);
        for (bit, generator) in (0..32).zip(&self.generators) {
            cycle.show(generator.pins.enable, enables >> bit & 1 != 0);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        self.write_rates(cycle);
        let enables = (0..).zip(self.pins().map(|pins| pins.enable));
        let enables = bits_of(cycle.pins, enables);
        for generator in &mut self.generators {
            let limit = Limit {
                setting: CorrectedValue::OutputType,
                number: generator.number.into(),
                lowest: 1,
                highest: 4,
                instead: Some(1),
            };
            limit.param(cycle, generator.pins.output_type);
            let shape = generator.pins.shape(cycle.pins, self.rate.bits);
            if shape != generator.shape {
                generator.shape = shape;
                cycle.words.set(generator.mode, shape.mode());
                // A repeated set-up writes the value that is at rest in this mode.
                cycle.words.put_safe(generator.value, shape.encode(0.0));
            }
            let fraction = cycle.pins.fetch(generator.pins.value);
            let is_on = enables & generator.enabled_by == generator.enabled_by;
            cycle.words.put(
                generator.value,
                shape.encode(if is_on { fraction } else { 0.0 }),
            );
        }
        cycle.words.put(self.enables, enables);
    }
}

impl PwmGenerator {
    fn new(
        r: &mut Registrar<'_>,
        of_kind: &DrivenModule,
        instance: u8,
        bits: u8,
    ) -> Result<Self, RegisterError> {
        let (module, number) = (&of_kind.descriptor, of_kind.number(instance));
        r.use_io(Gtag::PWM, number)?;
        let table = r.board.pwm.of(number);
        let pins = PwmPins::new(r, number, table, module.version >= 1)?;
        let shape = pins.shape(r.pins, bits);
        let (value, mode) = (module.register(0, instance)?, module.register(1, instance)?);
        // A double-buffered value would wait for the end of a period.
        r.image
            .step(Stage::Configure, mode, shape.mode() & !DOUBLE_BUFFERED);
        let bit = |n: u8| 1 << (n & 31);
        Ok(Self {
            pins,
            number,
            enabled_by: bit(instance) | of_kind.leader(r, number).map_or(0, bit),
            shape,
            value: r.image.output(value, shape.encode(0.0)),
            mode: r.image.setting(Stage::Configure, mode, shape.mode()),
        })
    }
}

impl PwmPins {
    fn new(
        r: &mut Registrar<'_>,
        number: u8,
        table: &PwmTable,
        has_dither: bool,
    ) -> Result<Self, RegisterError> {
        let dithers = r.settings.defaults == Defaults::Board;
        let [output, enable] =
            [table.outputs, table.enables].map(|ranges| Terminals::of(ranges, number.into()));
        let stem = format!("pwmgen.{number:02}.");
        let asked = r.settings.pwm.get(&number).copied().unwrap_or_default();
        let initial = initial(r, table);
        let scale = asked.scale.unwrap_or(initial.full_scale);
        let full_scale = scale.abs();
        let mut make = r.maker_at(&stem, output);
        let scale = make.scale("scale", scale)?;
        let value = Spec {
            unit: initial.unit.into(),
            range: Some((-full_scale, full_scale)),
            // The fetched value is a fraction of full scale.
            full_scale: Some(FullScale {
                scale,
                min: -1.0,
                max: 1.0,
            }),
            ..Spec::from("value")
        };
        let value = make.output(value, 0.0)?;
        let mut make = r.maker_at(&stem, enable);
        Ok(Self {
            value,
            enable: make.output("enable", false)?,
            offset_mode: make.setting(
                "offset-mode",
                asked.offset_mode.unwrap_or(initial.is_offset),
            )?,
            scale,
            output_type: make.setting("output-type", asked.output_type.unwrap_or(1))?,
            dither: has_dither
                .then(|| make.setting("dither", dithers))
                .transpose()?,
        })
    }

    fn shape(&self, pins: &PinStore, bits: u8) -> PwmShape {
        let output_type = pins.param(self.output_type);
        PwmShape {
            bits: if output_type == PDM { 12 } else { bits },
            output_type,
            offset: pins.param(self.offset_mode),
            dither: self.dither.is_some_and(|dither| pins.param(dither)),
        }
    }
}
