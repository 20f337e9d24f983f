//! Another host that starts after the bus was opened.

use super::*;
use crate::bus::BusError;

/// No packets of others reported.
const NOBODY: [u32; 0] = [];

/// Shares, in 16ths, of the packets that a network loses, delays or duplicates.
#[derive(Clone, Copy, Debug)]
struct Weather {
    lost: u32,
    late: u32,
    doubled: u32,
}

impl Weather {
    const GOOD: Self = Self {
        lost: 0,
        late: 0,
        doubled: 0,
    };

    fn fate(self, dice: u32) -> Fate {
        let delay = u64::from(dice >> 16) * 40;
        match dice % 16 {
            n if n < self.lost => Fate::Lost,
            n if n < self.lost + self.late => Fate::Arrives(delay),
            n if n < self.lost + self.late + self.doubled => Fate::Doubled(30_000, delay),
            _ => GOOD,
        }
    }
}

/// Runs cycles of 1 ms on such a network; returns the counts of others' packets that replies
/// reported, without zeros.
fn run(bus: &mut UdpBus<Network>, weather: Weather, dice: &[u32]) -> Vec<u32> {
    let cycle = Cycle::new(bus);
    let mut told = Vec::new();
    for &dice in dice {
        let link = bus.link();
        link.executed.clear();
        link.answers.clear();
        let [a, b, c] = [0, 5, 11].map(|turn| weather.fate(dice.rotate_left(turn)));
        (link.requests, link.replies) = (vec![b, a], vec![c]);
        let mut words = [0; 3];
        let _ = bus.run(&cycle.write, &mut words);
        if let Ok(reply) = bus.run(&cycle.read, &mut words) {
            told.extend(Some(reply.foreign_packets).filter(|others| *others > 0));
        }
        bus.wait(MS);
    }
    told
}

/// Reproducible dice that need no entry in a test framework's files.
fn dice(seed: u32, count: u32) -> Vec<u32> {
    let scramble = |n: u32| {
        let n = (n ^ n >> 16).wrapping_mul(0x7FEB_352D);
        let n = (n ^ n >> 15).wrapping_mul(0x846C_A68B);
        n ^ n >> 16
    };
    (0..count).map(|n| scramble(seed.wrapping_add(n))).collect()
}

#[test]
fn second_master_that_starts_later_is_reported_by_cycle_replies() {
    // A cycle of 1 kHz, and one of 100 Hz that writes and reads.
    for every in [500_000, 5_000_000] {
        let mut bus = bus();
        assert_eq!(run(&mut bus, Weather::GOOD, &dice(1, 2500)), NOBODY);
        let now = bus.link().now;
        bus.link().other_host = Some(every);
        bus.link().of_others = now / every;
        let told = run(&mut bus, Weather::GOOD, &dice(2, 3000));
        assert!(told.len() >= 2, "every {every} ns: {told:?}");
        let counted = bus.statistics().foreign_packets;
        assert_eq!(counted, told.iter().copied().map(u64::from).sum::<u64>());
        let error = bus.check_alone().unwrap_err();
        assert!(matches!(error, BusError::OtherHost { .. }), "{error}");
        assert!(bus.statistics().foreign_packets > counted);
        (bus.link().other_host, bus.link().of_others) = (None, 0);
        bus.check_alone().unwrap();
    }
}

#[test]
fn query_burst_of_another_program_is_not_reported() {
    let mut bus = bus();
    for _ in 0..4 {
        bus.link().received += 1000;
        assert_eq!(run(&mut bus, Weather::GOOD, &dice(1, 1100)), NOBODY);
    }
    assert_eq!(bus.statistics().foreign_packets, 0);
}

#[test]
fn no_second_master_is_reported_with_beside_others() {
    let config = UdpConfig {
        beside_others: true,
        ..UdpConfig::default()
    };
    let mut bus = UdpBus::new(Network::default(), config).unwrap();
    bus.link().other_host = Some(500_000);
    assert_eq!(run(&mut bus, Weather::GOOD, &dice(1, 2000)), NOBODY);
    assert_eq!(bus.statistics().foreign_packets, 0);
    bus.check_alone().unwrap();
}

#[test]
fn check_free_changes_only_the_request_number_of_a_board() {
    let mut network = Network::default();
    UdpBus::check_free(&mut network, UdpConfig::default()).unwrap();
    let changed: Vec<_> = network.scratch.keys().copied().collect();
    assert_eq!(changed, [0x1C, 0x1E]);
    network.other_host = Some(500_000);
    let error = UdpBus::check_free(&mut network, UdpConfig::default()).unwrap_err();
    assert!(matches!(error, BusError::OtherHost { .. }), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn no_second_master_is_reported_on_a_bad_network(
        seed in any::<u32>(), received in any::<u16>(),
        lost in 0..4_u32, late in 0..6_u32, doubled in 0..=16_u32,
    ) {
        let mut bus = bus();
        bus.link().received = received;
        let _ = bus.check_alone();
        let weather = Weather { lost, late, doubled };
        let told = run(&mut bus, weather, &dice(seed, 2500));
        prop_assert_eq!(told, NOBODY);
        prop_assert_eq!(bus.statistics().foreign_packets, 0);
    }

    #[test]
    fn second_master_is_reported_despite_lost_packets(
        seed in any::<u32>(), received in any::<u16>(), lost in 0..2_u32, late in 0..4_u32,
    ) {
        let mut bus = bus();
        bus.link().received = received;
        bus.link().other_host = Some(500_000);
        let weather = Weather { lost, late, doubled: 0 };
        let told = run(&mut bus, weather, &dice(seed, 3000));
        prop_assert!(told.len() >= 2, "{told:?}");
    }
}
