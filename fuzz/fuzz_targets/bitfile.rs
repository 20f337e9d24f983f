//! Any file: it is parsed or refused, and nothing in it is longer than the file.

#![no_main]

use libfuzzer_sys::fuzz_target;
use mesa_hal::ethernet::Bitfile;

/// The beginning of each bitfile.
const MARK: [u8; 13] = *b"\x00\x09\x0F\xF0\x0F\xF0\x0F\xF0\x0F\xF0\x00\x00\x01";

fn check(file: &[u8]) {
    if let Ok(bitfile) = Bitfile::parse(file) {
        let text = bitfile.design.len() + bitfile.part.len();
        assert!(text + bitfile.configuration.len() < file.len());
        let part = "6slx9tqg144";
        let is_taken = bitfile.check("7I97", part, usize::MAX).is_ok();
        assert!(!is_taken || bitfile.part.eq_ignore_ascii_case(part));
    }
}

fuzz_target!(|data: &[u8]| {
    check(data);
    check(&[&MARK, data].concat());
});
