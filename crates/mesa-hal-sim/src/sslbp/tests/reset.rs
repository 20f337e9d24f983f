//! State after a reset of the processor, and a START that is neither setup nor normal. FACTS 11.1,
//! 11.2, 11.12.

use super::{Bench, MS, PortConfig, REMOTE, US};
use crate::remote::{FixedData, SimRemote};
use crate::sslbp::Register;
use crate::wire::Nanos;

const CHANNEL_START: u32 = 0x70;
const CHANNEL_STRIDE: u32 = 0x32;

impl Bench {
    fn local_read(&mut self, address: u32) -> u32 {
        assert!(self.command(0x2000 | address, MS).is_some());
        self.read(Register::Data)
    }

    /// Changes all remotes.
    fn apply(&mut self, text: &str) {
        for end in self.lines.ends.iter_mut().flatten() {
            let end: &mut dyn core::any::Any = &mut **end;
            let remote: &mut SimRemote<FixedData> = end.downcast_mut().expect("a model");
            remote.apply(text).expect("an option");
        }
    }

    /// Releases the processor after a reset, and waits for its initialisation.
    fn reset(&mut self) {
        self.write(Register::Command, 0x4000);
        self.wait(10 * US);
        self.write(Register::Command, 0x0001);
        self.wait(MS);
    }

    /// Releases the processor; returns the time in which COMMAND shows the written word, up to 30
    /// us.
    fn release(&mut self) -> Nanos {
        self.write(Register::Command, 0x0001);
        let released = self.now;
        while self.read(Register::Command) != 0 && self.now < released + 30 * US {}
        self.now - released
    }
}

#[test]
fn reset_clears_the_lower_quarter_of_memory_only() {
    let mut bench = Bench::eight(&[REMOTE; 8]);
    bench.start(0x09FF);
    assert!(bench.command(0x10FF, MS).is_some());
    bench.wait(200 * US);
    bench.apply("fault=0x21");
    assert!(bench.command(0x10FF, MS).is_some());
    assert_eq!(bench.read(Register::Cs(0)) >> 24, 0x21);
    bench.local_write(0x035, 0x5A);
    bench.local_write(0x5F0, 0x5A);
    bench.wait(MS);

    bench.reset();
    for channel in 0..8 {
        let stays = channel >= 3;
        let kept = if stays { 0x2100_C100 } else { 0x0000_C100 };
        assert_eq!(bench.read(Register::Cs(channel)), kept, "channel {channel}");
        let base = CHANNEL_START + CHANNEL_STRIDE * u32::from(channel);
        assert_eq!(bench.local_read(base + 0x25) != 0, stays, "fault byte");
        assert_eq!(bench.local_read(base + 0x26) != 0, stays, "name");
        assert_eq!(
            bench.local_read(base + 0x2A),
            0xA0,
            "2.5 Mbaud is set up anew"
        );
        // The sizes of channel 2 are at 102.
        assert_eq!(bench.local_read(base + 0x2E) != 0, channel >= 2, "size");
        assert_eq!(bench.local_read(base + 0x30) != 0, channel >= 2, "time");
    }
    assert_eq!(bench.local_read(0x035), 0);
    assert_eq!(bench.local_read(0x5F0), 0x5A);

    bench.apply("fault=0");
    assert!(bench.command(0x09FF, 60 * MS).is_some());
    assert_eq!(bench.read(Register::Cs(7)) >> 24, 0x21, "until a DOIT");
    assert!(bench.command(0x10FF, MS).is_some());
    assert_eq!(bench.read(Register::Cs(7)) >> 24, 0);
}

#[test]
fn command_clears_at_once_only_in_an_idle_initialised_8_build() {
    let at_once = |channels: u8, remotes: &[&str], prepare: &dyn Fn(&mut Bench)| {
        let mut bench = Bench::new(PortConfig::new(channels, 100_000_000), remotes);
        prepare(&mut bench);
        bench.write(Register::Command, 0x4000);
        bench.wait(20 * US);
        let shown = bench.release();
        assert!(!(200..=21 * US).contains(&shown), "{shown} ns");
        shown < 200
    };
    assert!(at_once(8, &[], &|_| {}));
    assert!(!at_once(5, &[], &|_| {}));
    assert!(!at_once(8, &[REMOTE], &|bench| bench.start(0x0901)));
    // STOPALL does not initialise memory.
    assert!(!at_once(8, &[], &|bench| {
        bench.write(Register::Command, 0x0800);
        bench.wait(50 * US);
    }));
}

#[test]
fn second_reset_within_initialisation_waits_for_memory() {
    for (channels, expected) in [(5, 21_800), (8, 22_400)] {
        for after in [US, 5 * US, 10 * US, 20 * US, 22 * US, 30 * US, 40 * US] {
            let mut bench = Bench::new(PortConfig::new(channels, 100_000_000), &[]);
            bench.write(Register::Command, 0x4000);
            bench.wait(20 * US);
            bench.write(Register::Command, 0x0001);
            bench.wait(after);
            bench.write(Register::Command, 0x4000);
            bench.wait(20 * US);
            let shown = bench.release();
            assert!(
                shown.abs_diff(expected) <= 150,
                "{channels} channels, {after} ns: {shown} ns"
            );
            bench.wait(MS);
            assert_eq!(bench.local_read(3), 43);
        }
    }
}

#[test]
fn a_7i64_stays_in_state_17_if_a_doit_overwrites_its_start() {
    let remote = "present=1 name=7I64 unit=1 mode0=8,4,1,2";
    let mut bench = Bench::eight(&[remote]);
    assert!(bench.command(0x0800, MS).is_some());
    bench.wait(200 * US);
    bench.write(Register::Command, 0x0901);
    bench.wait(10 * US);
    assert_eq!(bench.command(0x1001, 20 * MS), None);
    assert_eq!(bench.read(Register::Command), 0x1001);
    assert_eq!(bench.read(Register::Cs(0)) >> 16, 0x17);
    assert!(bench.command(0x08FF, MS).is_some());
    bench.wait(50 * US);
    // The remedy: a stop, and a START that nothing overwrites.
    assert!(bench.command(0x08FF, MS).is_some());
    bench.wait(50 * US);
    assert_eq!(bench.read(Register::Cs(0)), 0x0000_C100);
    assert!(bench.command(0x0901, 20 * MS).is_some());
    assert_eq!(bench.read(Register::Data), 0);
}
