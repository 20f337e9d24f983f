//! The serial ports of the simulated FPGA, register by register: their pins, the watchdog, and
//! several ports with seven interface registers.

use std::time::Duration;

use crate::common::fpga::set_up_pins;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal_sim::remote::{FixedData, SimRemote};
use mesa_hal_sim::{SimFpga, gtag, machines};

/// Register addresses of one port, according to its module descriptor.
#[derive(Clone, Copy)]
struct Port {
    base: u16,
}

impl Port {
    const FIRST: Self = Self { base: 0x5B00 };

    fn interface(self, channel: u16, n: u16) -> u16 {
        self.base + 0x300 + 0x100 * n + 4 * channel
    }

    fn command(self, fpga: &mut SimFpga, command: u32) -> u32 {
        fpga.write(self.base, command).expect("write");
        for _ in 0..200_000 {
            if fpga.read(self.base).expect("read") == 0 {
                return fpga.read(self.base + 0x100).expect("read") & 0xFF;
            }
        }
        panic!("COMMAND {command:#06x} never cleared");
    }
}

/// A remote as in the transcripts, with the sizes of one mode.
fn model(name: &str, rx: u8, tx: u8) -> Box<SimRemote<FixedData>> {
    let mut remote = SimRemote::model();
    let line = format!("present=1 name={name} unit=1 mode0={rx},{tx},0,0");
    remote.apply(&line).expect("model");
    Box::new(remote)
}

/// Waits longer than the power-up of the ports takes.
fn settle(fpga: &mut SimFpga) {
    fpga.wait(Duration::from_millis(1));
}

fn outputs(fpga: &SimFpga, port: usize, channel: usize) -> &[u8] {
    let remote = fpga.device::<SimRemote<FixedData>>(port, channel);
    remote.expect("remote").application().outputs()
}

#[test]
fn channel_without_pin_set_up_reaches_no_remote() {
    let mut fpga = machines::i7i97(2);
    for channel in 0..2 {
        fpga.plug(0, channel, Some(model("7I72", 1, 6)));
    }
    // TX and TXEN of channel 0 (I/O 32 and 33), TX of channel 1 (I/O 35).
    fpga.write(0x1204, 0x1_8000).expect("write");
    fpga.write(0x1104, 0x0_8000).expect("write");
    fpga.write(0x1208, 0x2).expect("write");
    fpga.write(0x1108, 0x2).expect("write");
    settle(&mut fpga);
    let port = Port::FIRST;
    assert_eq!(port.command(&mut fpga, 0x0903), 1, "no TXEN on channel 0");
    assert_eq!(port.command(&mut fpga, 0x0800), 0xAA);
    fpga.write(0x1104, 0x1_8000).expect("write");
    settle(&mut fpga);
    assert_eq!(port.command(&mut fpga, 0x0903), 0);
}

#[test]
fn watchdog_silences_the_ports() {
    let mut fpga = machines::i7i92_7i77();
    fpga.plug(0, 0, Some(model("7I77", 5, 2)));
    set_up_pins(&mut fpga);
    settle(&mut fpga);
    let port = Port::FIRST;
    assert_eq!(port.command(&mut fpga, 0x0901), 0);
    assert_eq!(port.command(&mut fpga, 0x1001), 0);
    fpga.write(0x0C00, 99_999).expect("write");
    fpga.wait(Duration::from_millis(2));
    assert_eq!(fpga.read(0x0D00).expect("read"), 1);
    assert_eq!(port.command(&mut fpga, 0x1001), 1, "no reply any more");
}

#[test]
fn seven_interface_registers_reach_their_channels_and_ports() {
    let firmware = machines::firmware_serial(&[2, 1, 8, 3]);
    let mut fpga = SimFpga::new(machines::with_seven_interface_registers(firmware));
    assert_eq!(fpga.serial_ports(), 4);
    for (port, channel) in [(0, 1), (2, 7), (3, 2)] {
        fpga.plug(port, channel, Some(model("BIG1", 13, 12)));
    }
    set_up_pins(&mut fpga);
    settle(&mut fpga);
    for (number, channel) in [(0, 1), (2, 7), (3, 2)] {
        let port = Port {
            base: 0x5B00 + 0x40 * number,
        };
        assert_eq!(port.command(&mut fpga, 0x0900 | 1 << channel), 0);
        for n in 0..3u16 {
            let value = u32::from(number) << 24 | (u32::from(n) + 1);
            fpga.write(port.interface(channel, n), value)
                .expect("write");
        }
        assert_eq!(port.command(&mut fpga, 0x1000 | 1 << channel), 0);
        let n = number as u8;
        let expected = [1, 0, 0, n, 2, 0, 0, n, 3, 0, 0, n];
        let got = outputs(&fpga, usize::from(number), usize::from(channel));
        assert_eq!(got, expected);
        let last = fpga.read(port.interface(channel, 2)).expect("read");
        assert_eq!(last, 0xCCBB_AA99);
        assert_eq!(fpga.read(port.interface(channel, 6)).expect("read"), 0);
    }
    assert_eq!(fpga.counters().unknown_reads, 0);
    assert_eq!(fpga.counters().unknown_writes, 0);
    let descriptor = fpga.firmware().module(gtag::SSERIAL_B).expect("module");
    assert_eq!((descriptor.registers, descriptor.multiple), (10, 0x3FC));
}
