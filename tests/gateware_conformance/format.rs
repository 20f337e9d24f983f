//! The parser of the recordings accepts every kind of line, and nothing else.

use crate::common::recording::sslbp::{Event, Transcript};
use crate::common::recording::{Recording, Unreadable};
use mesa_hal_sim::sslbp::Register;

const HEADER: &str = "# what\n# gateware x, 3 channels, ClockLow=ClockMed=100 MHz, 2.5 Mbaud\n";

fn parse(lines: &str) -> Result<Transcript, Unreadable> {
    Transcript::parse("test", &format!("{HEADER}{lines}"))
}

#[test]
fn every_kind_of_line_is_read() {
    let transcript = parse(concat!(
        "0.00 sim remote2 present=1 name=7I77\n",
        "1.50 host write IF2[7] 0xFFFF1234\n",
        "2.00 host poll COMMAND 0x00000000 ; waited=0.53\n",
        "12.06 ch1 fpga->remote EB 28 B7 ; start=2.00\n",
        "20.00 ch1 remote->fpga BREAK 00 ; start=16.00\n",
        "21.00 sim wire log off\n",
        "22.00 note text with spaces\n",
    ))
    .unwrap();
    assert_eq!((transcript.channels, transcript.clock_hz), (3, 100_000_000));
    let events: Vec<_> = transcript.entries.into_iter().map(|e| e.event).collect();
    assert_eq!(
        events[1],
        Event::Write {
            register: Register::Interface(7, 2),
            value: 0xFFFF_1234
        }
    );
    assert_eq!(
        events[2],
        Event::Poll {
            value: 0,
            waited: 530,
            timed_out: false
        }
    );
    assert_eq!(
        events[3],
        Event::FromFpga {
            channel: 1,
            start: 2_000,
            bytes: vec![0xEB, 0x28, 0xB7]
        }
    );
    assert!(matches!(events[4], Event::ToFpga { is_break: true, .. }));
    assert_eq!(events[5], Event::WireLogOff);
}

#[test]
fn damaged_line_is_named() {
    for (damaged, line) in [
        ("1.00 host write CS[0] 0x1234\n", 3),
        ("1.00 host read CS[8] 0x00000000\n", 3),
        (
            "1.00 host write COMMAND 0x00000800\n0.50 note back in time\n",
            4,
        ),
        ("1.00 ch0 fpga->remote DG 16 ; start=0.00\n", 3),
        ("1.00 ch0 fpga->remote DF 16\n", 3),
        ("1.0x note\n", 3),
        (
            "1.00 host poll COMMAND 0x00000000 ; waited=1.00 TIMEOUT\n",
            3,
        ),
        ("1.00 guest read CS[0] 0x00000000\n", 3),
        ("1.00 note cut off", 3),
    ] {
        assert_eq!(
            parse(damaged).map_err(|error| error.line).err(),
            Some(line),
            "{damaged}"
        );
    }
    assert!(Transcript::parse("test", "# only\n# a header\n").is_err());
}
