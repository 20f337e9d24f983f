//! Each firmware is started: names of its pins, terminals, driven pins, and remarks about the rest.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver, RemarkKind};
use mesa_hal::modules::UndrivenReason;
use mesa_hal_sim::{FirmwareImage, SimFpga};

use super::truth::{Truth, is_driven, tag};
use super::{Image, each, same};

fn start(image: &Image) -> Result<Driver<SimFpga>, String> {
    let parsed = FirmwareImage::parse(&image.text).map_err(|error| error.to_string())?;
    let fpga = SimFpga::from_image(&parsed).map_err(|error| error.to_string())?;
    Driver::start(fpga, Settings::default()).map_err(|error| error.to_string())
}

fn cycle(driver: &mut Driver<SimFpga>) -> Result<(), String> {
    let report = driver.read().map_err(|error| error.to_string())?;
    driver.write().map_err(|error| error.to_string())?;
    same("state", &report.board, &BoardState::Running)
}

#[test]
fn every_firmware_has_linuxcnc_names_and_undriven_modules_named() {
    each(|image| {
        let mut driver = start(image)?;
        for _ in 0..5 {
            cycle(&mut driver)?;
            driver.bus_mut().wait(Duration::from_millis(1));
        }
        let truth = &image.truth;
        families(&driver, truth)?;
        gpio(&driver, truth)?;
        terminals(&driver, truth)?;
        let remarked = remarks(&driver, truth)?;
        let there = truth.modules.iter().filter(|module| module.instances > 0);
        let driven = there
            .clone()
            .filter(|module| is_driven(truth, module))
            .count();
        println!(
            "{}: modules {}, driven {driven}, remarked {remarked}, pins {}",
            image.name,
            there.count(),
            driver.pins().infos().len()
        );
        Ok(())
    });
}

/// Compares the pins of instances with those expected, by the part of their names that contains the
/// number: all of these kinds, and no others.
fn families(driver: &Driver<SimFpga>, truth: &Truth) -> Result<(), String> {
    let mut expected = BTreeSet::new();
    let mut add = |name: String| expected.insert(name);
    let encoders = truth.instances(tag::ENCODER) + truth.instances(tag::MUXED);
    (0..encoders).for_each(|n| assert!(add(format!("encoder.{n:02}.count"))));
    let generators = truth.instances(tag::PWM);
    (0..generators).for_each(|n| assert!(add(format!("pwmgen.{n:02}.value"))));
    let generators = truth.instances(tag::STEPGEN);
    (0..generators).for_each(|n| assert!(add(format!("stepgen.{n:02}.position-fb"))));
    for (kind, name) in [(tag::IN_MUX, "inmux"), (tag::IN_M, "inm")] {
        for unit in 0..truth.instances(kind) {
            for input in 0..truth.inputs(kind, unit) {
                assert!(add(format!("{name}.{unit:02}.input-{input:02}")));
            }
        }
    }
    for (kind, name) in [(tag::SSR, "ssr"), (tag::OUT_M, "outm")] {
        for unit in 0..truth.instances(kind) {
            let outputs = truth
                .of(kind, unit)
                .filter(|(_, pin)| (0x81..0xA0).contains(&pin.signal));
            for (_, pin) in outputs {
                add(format!("{name}.{unit:02}.out-{:02}", pin.signal - 0x81));
            }
        }
    }
    (0..truth.ports().len()).for_each(|port| assert!(add(format!("sserial.port-{port}.run"))));
    if truth.instances(tag::DPLL) > 0 {
        add("dpll.phase-error-us".into());
    }
    add("watchdog.has_bit".into());
    let prefix = format!("hm2_{}.0.", truth.linuxcnc_name());
    let ends = [
        ".count",
        ".value",
        ".position-fb",
        ".run",
        ".has_bit",
        ".phase-error-us",
    ];
    let is_numbered = |name: &str| {
        let numbered = name.rsplit_once('-').is_some_and(|(stem, number)| {
            let is_io = [".input", ".out"].iter().any(|kind| stem.ends_with(kind));
            is_io && !stem.contains("raw") && number.parse::<u8>().is_ok()
        });
        ends.iter().any(|end| name.ends_with(end)) || numbered
    };
    let mut found = BTreeSet::new();
    for info in driver.pins().infos() {
        let own = info.name.strip_prefix(&prefix);
        let own = own.ok_or_else(|| format!("{} does not begin with {prefix}", info.name))?;
        if is_numbered(own) {
            found.insert(own.to_owned());
        }
    }
    let names = driver.pins().infos().iter().map(|info| &info.name);
    same(
        "different names",
        &names.collect::<BTreeSet<_>>().len(),
        &driver.pins().infos().len(),
    )?;
    let missing: Vec<_> = expected.difference(&found).collect();
    let more: Vec<_> = found.difference(&expected).collect();
    same(
        "missing names, and unexpected ones",
        &(missing, more),
        &(vec![], vec![]),
    )
}

/// The I/O pins that a module uses: those of driven modules.
fn used(truth: &Truth) -> BTreeSet<u16> {
    let ports = truth.ports();
    let mut used = BTreeSet::new();
    for (number, pin) in (0_u16..).zip(&truth.pins) {
        let modules = truth.modules.iter().filter(|module| module.tag == pin.tag);
        let mut modules = modules.filter(|module| module.instances > 0);
        let is_there = modules.any(|module| {
            let units = if pin.tag == tag::MUXED {
                module.instances.div_ceil(2)
            } else {
                module.instances
            };
            let is_shared = pin.tag == tag::STEPGEN && module.version == 0xC2 && pin.unit == 0x80;
            let is_its = pin.unit < units || pin.tag == tag::SELECT || is_shared;
            // Further outputs of step generators are for tables.
            let is_of_table = pin.tag == tag::STEPGEN && pin.signal >= 0x83;
            is_its && !is_of_table && is_driven(truth, module)
        });
        // Multiplexed encoders need their select line, whether a module is listed for it or not.
        let is_select = pin.tag == tag::SELECT && truth.instances(tag::MUXED) > 0;
        let is_there = is_there || is_select;
        let is_serial = matches!(pin.tag, tag::SSERIAL | tag::SSERIAL_B);
        // No remote is plugged in, but the channels are still polled.
        let is_channel = ports.iter().any(|(tag, unit, channels)| {
            (*tag, *unit) == (pin.tag, pin.unit) && pin.signal & 0xF <= *channels
        });
        // Pins of the DPLL are made by no module.
        if is_there && pin.tag != tag::DPLL && (!is_serial || is_channel) {
            used.insert(number);
        }
    }
    used
}

/// Checks that pins without a module are plain I/O, with all its pins and parameters.
fn gpio(driver: &Driver<SimFpga>, truth: &Truth) -> Result<(), String> {
    let used = used(truth);
    let names: BTreeSet<_> = driver
        .pins()
        .infos()
        .iter()
        .map(|info| info.name.as_str())
        .collect();
    for (number, pin) in (0_u16..).zip(&truth.pins) {
        let name = |end: &str| format!("hm2_{}.0.gpio.{number:03}.{end}", truth.linuxcnc_name());
        let is_free = !used.contains(&number);
        let drives = pin.tag != 0 && pin.signal & 0x80 != 0;
        for (end, is_there) in [
            ("out", is_free),
            ("is_output", is_free),
            ("in", is_free || !drives),
            ("in_not", is_free || !drives),
            ("invert_output", is_free || drives),
            ("is_opendrain", is_free || drives),
        ] {
            same(&name(end), &names.contains(name(end).as_str()), &is_there)?;
        }
    }
    Ok(())
}

/// DB25 pins of a connector of 17 I/O pins, in their order: manuals 7I77 and 7I97.
const DB25: [u8; 17] = [1, 14, 2, 15, 3, 16, 4, 17, 5, 6, 7, 8, 9, 10, 11, 12, 13];

/// Checks the terminals of plain I/O, on boards whose connectors are known.
fn terminals(driver: &Driver<SimFpga>, truth: &Truth) -> Result<(), String> {
    let name = truth.linuxcnc_name();
    let is_level = |end: &str| matches!(end, "in" | "out");
    for info in driver.pins().infos() {
        let prefix = format!("hm2_{name}.0.gpio.");
        let own = info.name.strip_prefix(&prefix);
        // Settings of a pin are at no terminal.
        let Some(own) = own.filter(|own| own.split('.').nth(1).is_some_and(is_level)) else {
            continue;
        };
        let number: usize = own
            .split('.')
            .next()
            .and_then(|n| n.parse().ok())
            .expect("a number");
        let connector = match (name, number) {
            ("7i92", 0..17) => Some("P2 DB25"),
            ("7i92", 17..34) => Some("P1 DB25"),
            ("7i97", 34..51) => Some("DB25"),
            _ => None,
        };
        if let Some(connector) = connector {
            let expected = format!("{connector} pin {}", DB25[number % 17]);
            let terminal = &info.place.terminal;
            if !terminal.ends_with(&expected) {
                return Err(format!(
                    "{}: at {terminal:?}, expected {expected}",
                    info.name
                ));
            }
        }
    }
    Ok(())
}

/// Checks that every module that is not driven is in the remarks, with its pins; returns their
/// number.
fn remarks(driver: &Driver<SimFpga>, truth: &Truth) -> Result<usize, String> {
    let mut expected = BTreeMap::<u8, Vec<u16>>::new();
    for module in truth.modules.iter().filter(|module| module.instances > 0) {
        if !is_driven(truth, module) {
            let pins = (0_u16..).zip(&truth.pins);
            let own = pins
                .filter(|(_, pin)| pin.tag == module.tag)
                .map(|(number, _)| number);
            assert!(expected.insert(module.tag, own.collect()).is_none());
        }
    }
    let mut found = BTreeMap::new();
    let (mut too_many, mut old) = (Vec::new(), 0);
    for remark in driver.remarks() {
        if let RemarkKind::OldStepgen { version } = remark.kind {
            let mut modules = truth.modules.iter();
            let is_its = modules.any(|m| m.tag == tag::STEPGEN && m.version == version);
            same("old step generators", &(is_its, version < 2), &(true, true))?;
            old += 1;
            continue;
        }
        let RemarkKind::Undriven(module) = &remark.kind else {
            return Err(format!("unexpected remark: {remark}"));
        };
        if let UndrivenReason::Channels { .. } = module.reason {
            too_many.extend(module.pins.iter().copied());
        } else {
            found.insert(module.gtag.0, module.pins.clone());
        }
        let text = remark.to_string();
        let is_named = text.contains(&format!("({:02X})", module.gtag.0));
        same("the remark names its module", &is_named, &true)?;
    }
    same("modules in the remarks", &found, &expected)?;
    let channels = (0_u16..).zip(&truth.pins).filter(|(_, pin)| {
        matches!(pin.tag, tag::SSERIAL | tag::SSERIAL_B)
            && pin.signal < 0xB0
            && pin.signal & 0xF > 8
    });
    let channels: Vec<_> = channels.map(|(number, _)| number).collect();
    same("channels in the remarks", &too_many, &channels)?;
    let old_modules = truth
        .modules
        .iter()
        .any(|module| module.tag == tag::STEPGEN && module.version < 2 && module.instances > 0);
    same(
        "remarks on old step generators",
        &old,
        &usize::from(old_modules),
    )?;
    Ok(driver.remarks().len())
}

#[test]
fn no_unrequested_pin_is_driven_after_start_of_any_firmware() {
    each(|image| {
        let mut driver = start(image)?;
        quiet(driver.bus_mut(), &image.truth)?;
        for number in 0..4 {
            cycle(&mut driver)?;
            quiet(driver.bus_mut(), &image.truth)
                .map_err(|error| format!("cycle {number}: {error}"))?;
            driver.bus_mut().wait(Duration::from_micros(700));
        }
        Ok(())
    });
}

/// Checks every pin for 200 us. Only outputs of driven modules are driven, and these are at rest:
/// PWM is low, enables are off, outputs do not conduct. The analog outputs of a 7I97 are at 0 V,
/// which is high for half of the time, with their drives off.
fn quiet(fpga: &mut SimFpga, truth: &Truth) -> Result<(), String> {
    let used = used(truth);
    let analog = if truth.linuxcnc_name() == "7i97" {
        6
    } else {
        0
    };
    for _ in 0..100 {
        fpga.wait(Duration::from_micros(2));
        for (number, pin) in (0_u16..).zip(&truth.pins) {
            let at = usize::from(number);
            let drives = used.contains(&number) && pin.signal & 0x80 != 0;
            same(
                &format!("pin {number} is driven"),
                &fpga.is_driven(at),
                &drives,
            )?;
            let is_high = fpga.driven_level(at);
            let rest = match (pin.tag, pin.signal) {
                (tag::PWM, 0x81 | 0x82) if pin.unit >= analog => Some(false),
                // Active low.
                (tag::PWM, 0x83) => Some(true),
                (tag::OUT_M, _) => Some(false),
                _ => None,
            };
            if let Some(rest) = rest.filter(|_| drives) {
                same(&format!("level of pin {number}"), &is_high, &Some(rest))?;
            }
        }
        for (_, pin) in (0_u16..)
            .zip(&truth.pins)
            .filter(|(_, pin)| pin.tag == tag::SSR)
        {
            let output = usize::from(pin.signal & 0x7F) - 1;
            same("an SSR conducts", &fpga.isolated_output(output), &false)?;
        }
    }
    for output in 0..usize::from(analog.min(truth.instances(tag::PWM))) {
        let signal = fpga.analog_output(output);
        same("analog volts", &signal.volts, &0.0)?;
        same("analog enable", &signal.enabled, &false)?;
    }
    Ok(())
}
