//! The inventory for programs.

use mesa_hal::discovery::{DataDirection, DataRecord, ModeType};
use serde_json::{Value, json};

use super::report::{ChannelReport, PortReport, RemoteReport, Report};
use super::terminals;

pub fn of(report: &Report) -> Value {
    let idrom = &report.firmware.idrom;
    json!({
        "ethernet": report.identity.as_ref().map(|identity| json!({
            "card": identity.card,
            "mac": identity.mac.to_string(),
            "eeprom_ip": identity.eeprom_ip.to_string(),
            "eeprom_netmask": identity.eeprom_netmask.map(|mask| mask.to_string()),
            "lbp_version": identity.lbp_version,
            "firmware_version": identity.firmware_version,
            "jumpers": identity.jumpers,
        })),
        "firmware": {
            "board": idrom.board_name,
            "io_pins": idrom.io_width,
            "connectors": idrom.io_ports,
            "clock_low_hz": idrom.clock_low_hz,
            "clock_high_hz": idrom.clock_high_hz,
            "warnings": report.firmware.warnings.iter().map(ToString::to_string).collect::<Vec<_>>(),
            "modules": report.firmware.modules.iter().map(|module| json!({
                "module": module.gtag.to_string(),
                "gtag": module.gtag.0,
                "version": module.version,
                "instances": module.instances,
                "base": module.base,
                "clock_hz": module.clock_hz,
            })).collect::<Vec<_>>(),
            "pins": report.firmware.pins.iter().enumerate().map(|(number, pin)| json!({
                "number": number,
                "terminals": terminals::of(&report.firmware, number, *pin),
                "function": pin.to_string(),
                "driven_by_module": pin.is_output(),
            })).collect::<Vec<_>>(),
        },
        "serial_ports": report.ports.iter().map(port).collect::<Vec<_>>(),
    })
}

fn port(port: &PortReport) -> Value {
    json!({
        "port": port.number,
        "sslbp": format!("{}.{}", port.parameters.major, port.parameters.minor),
        "clock_hz": port.parameters.clock_hz,
        "channels": port.channels.iter().map(channel).collect::<Vec<_>>(),
    })
}

fn channel(channel: &ChannelReport) -> Value {
    match &channel.remote {
        Ok(found) => json!({ "channel": channel.number, "remote": remote(found) }),
        Err(reason) => json!({ "channel": channel.number, "not_started": reason }),
    }
}

fn remote(remote: &RemoteReport) -> Value {
    let descriptor = &remote.descriptor;
    json!({
        "name": descriptor.name.to_string(),
        "known_as": remote.table.map(|table| table.title),
        "unit_number": descriptor.unit_number,
        "software_mode": descriptor.software_mode,
        "rx_size": remote.sizes.0,
        "tx_size": remote.sizes.1,
        "built_in_table": remote.built_in,
        "modes": remote.modes().map(|mode| json!({
            "index": mode.index,
            "type": match mode.mode_type {
                ModeType::Hardware => "hardware",
                ModeType::Software => "software",
                ModeType::Other(_) => "other",
            },
            "name": mode.name,
        })).collect::<Vec<_>>(),
        "process_data": descriptor.process_data.iter().map(|record| {
            let mut element = data(record);
            let known = remote.table.and_then(|table| table.element(&record.name, record.direction));
            let places = known.iter().flat_map(|known| known.places(None));
            element["terminals"] = places.map(|at| {
                json!({ "place": at.terminal, "signal": at.signal })
            }).collect();
            element
        }).collect::<Vec<_>>(),
        "parameters": remote.parameters.iter().map(|(record, value)| {
            let mut parameter = data(record);
            match value {
                Ok(value) => {
                    parameter["value"] = json!(value.value);
                    parameter["raw"] = json!(value.raw);
                }
                Err(error) => parameter["error"] = json!(error),
            }
            parameter
        }).collect::<Vec<_>>(),
        "differences": remote.differences,
        "problems": remote.problems,
        "memory_accesses": remote.accesses,
    })
}

fn data(record: &DataRecord) -> Value {
    json!({
        "name": record.name,
        "bits": record.bits,
        "type": format!("{:?}", record.data_type),
        "nonvolatile": record.data_type.is_nonvolatile(),
        "direction": match record.direction {
            DataDirection::Input => "input",
            DataDirection::Output => "output",
            DataDirection::Bidirectional => "bidirectional",
        },
        "min": record.min,
        "max": record.max,
        "unit": record.unit,
        "address": record.address,
    })
}
