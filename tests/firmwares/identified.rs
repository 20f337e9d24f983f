//! Each firmware is identified: header, modules, pins and their names.

use mesa_hal::hostmot2::{HostMot2, PinDescriptor};
use mesa_hal_sim::{FirmwareImage, SimFpga};

use super::truth::{Module, Pin};
use super::{Image, each, names, same};

#[test]
fn modules_and_pins_of_every_firmware_match_its_words() {
    each(|image| {
        let parsed = FirmwareImage::parse(&image.text).map_err(|error| error.to_string())?;
        let mut fpga = SimFpga::from_image(&parsed).map_err(|error| error.to_string())?;
        let found = HostMot2::identify(&mut fpga).map_err(|error| error.to_string())?;
        check(image, &found)
    });
}

fn check(Image { truth, .. }: &Image, found: &HostMot2) -> Result<(), String> {
    same("board", &found.idrom.board_name, &truth.board)?;
    same(
        "name",
        &found.idrom.board(),
        &truth.linuxcnc_name().to_owned(),
    )?;
    let modules: Vec<_> = found
        .modules
        .iter()
        .map(|module| module_words(found, module))
        .collect();
    let expected: Vec<_> = truth
        .modules
        .iter()
        .map(|module| {
            (
                Module {
                    strides: 0,
                    ..*module
                },
                clock(truth, module),
            )
        })
        .collect();
    same("modules", &modules, &expected)?;
    // The choices of a descriptor are distances; two choices may be the same distance.
    for (found, module) in found.modules.iter().zip(&truth.modules) {
        let expected = [
            truth.register_strides[usize::from(module.strides & 0xF)],
            truth.instance_strides[usize::from(module.strides >> 4)],
        ];
        let distances = [found.register_stride, found.instance_stride].map(u32::from);
        same("strides", &distances, &expected)?;
    }
    let trailing = found.trailing.iter().map(|entry| {
        (
            entry.slot,
            entry.tag,
            entry.version,
            entry.instances,
            entry.base,
            entry.mask,
        )
    });
    let behind = truth
        .behind
        .iter()
        .map(|(slot, m)| (*slot, m.tag, m.version, m.instances, m.base, m.mask));
    same(
        "behind the end",
        &trailing.collect::<Vec<_>>(),
        &behind.collect::<Vec<_>>(),
    )?;
    for module in &truth.modules {
        let shown = mesa_hal::hostmot2::Gtag(module.tag).to_string();
        let expected = match names::module(module.tag) {
            Some(name) => format!("{name} ({:02X})", module.tag),
            None if names::UNKNOWN.contains(&module.tag) => {
                format!("unknown module ({:02X})", module.tag)
            }
            None => return Err(format!("no name for module {:02X}", module.tag)),
        };
        same("module", &shown, &expected)?;
    }
    pins(&found.pins, &truth.pins)?;
    pins(&found.local_pins, &truth.local)
}

fn clock(truth: &super::Truth, module: &Module) -> u32 {
    truth.clocks[usize::from(module.clock == 2)]
}

/// The words of a module descriptor of the crate, and its clock.
fn module_words(found: &HostMot2, module: &mesa_hal::hostmot2::ModuleDescriptor) -> (Module, u32) {
    let clock = if module.clock_hz == found.idrom.clock_low_hz {
        1
    } else {
        2
    };
    (
        Module {
            tag: module.gtag.0,
            version: module.version,
            clock,
            instances: module.instances,
            base: module.base,
            registers: module.registers,
            strides: 0,
            mask: module.multiple_registers,
        },
        module.clock_hz,
    )
}

fn pins(found: &[PinDescriptor], expected: &[Pin]) -> Result<(), String> {
    same("number of pins", &found.len(), &expected.len())?;
    for (number, (found, pin)) in found.iter().zip(expected).enumerate() {
        let what = format!("pin {number}");
        let words = (
            found.secondary_pin,
            found.secondary.0,
            found.unit,
            found.primary.0,
        );
        same(&what, &words, &(pin.signal, pin.tag, pin.unit, pin.primary))?;
        same(&what, &found.to_string(), &shown(*pin)?)?;
        let drives = pin.tag != 0 && pin.signal & 0x80 != 0;
        same(&what, &found.is_output(), &drives)?;
    }
    Ok(())
}

fn shown(pin: Pin) -> Result<String, String> {
    if pin.tag == 0 {
        return Ok("I/O".into());
    }
    let unit = match pin.unit {
        0x80 => "all".to_owned(),
        unit => unit.to_string(),
    };
    if names::UNKNOWN.contains(&pin.tag) {
        return Ok(format!(
            "module {:02X} {unit} pin {:02X}",
            pin.tag, pin.signal
        ));
    }
    let named = names::module(pin.tag).zip(names::pin(pin.tag, pin.signal));
    let (module, name) = named.ok_or_else(|| format!("no name for {pin:02X?}"))?;
    Ok(format!("{module} {unit} {name}"))
}
