use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal_sim::{BoardConfig, Motor};

use super::*;

fn simulated(passage: Passage) -> Simulated {
    let fpga = mesa_hal_sim::machines::six_axes_7i92(Motor::default());
    let simulated = Simulated::new(SimBoard::new(BoardConfig::new("7I92"), fpga));
    simulated.set_passage(passage);
    simulated
}

const LONG: Duration = Duration::from_secs(3600);

#[test]
fn virtual_time_passes_with_waits_and_exchanges_only() {
    let mut bus = UdpBus::new(simulated(Passage::Virtual).link(), UdpConfig::default()).unwrap();
    let begun = bus.now();
    std::thread::sleep(Duration::from_millis(2));
    assert_eq!(bus.now(), begun);
    bus.wait(LONG);
    bus.sleep(LONG);
    assert_eq!(bus.now().since(begun), 2 * LONG);
    bus.check_alone().unwrap();
    assert!(bus.now().since(begun) > 2 * LONG);
}

#[test]
fn board_state_is_kept_for_the_next_link() {
    let simulated = simulated(Passage::Virtual);
    let mut first = simulated.link();
    first.sleep(LONG);
    let at = first.now();
    drop(first);
    assert_eq!(simulated.link().now(), at);
}

#[test]
fn paced_time_is_never_ahead_and_drops_a_long_lag() {
    let host = HostClock::new();
    let simulated = simulated(Passage::Paced);
    let mut link = simulated.link();
    let ms = Duration::from_millis;
    let begun = link.now();
    for _ in 0..10 {
        link.sleep(ms(2));
        assert!(link.now().since(begun) <= host.read().since(Instant::from_nanos(0)));
    }
    std::thread::sleep(ms(200));
    // It goes on at once, and does not run until the pause is made up for.
    link.sleep(ms(1));
    let (at, real) = (link.now(), host.read());
    link.sleep(ms(100));
    assert_eq!(link.now().since(at), ms(100));
    assert!(host.read().since(real) + Duration::from_nanos(MAX_LAG) >= ms(100));
}

#[test]
fn pause_of_the_program_counts_on_the_host_clock() {
    let mut link = simulated(Passage::Host).link();
    let begun = link.now();
    std::thread::sleep(Duration::from_millis(2));
    assert!(link.now().since(begun) >= Duration::from_millis(2));
    let deadline = link.now().after(Duration::from_millis(1));
    assert_eq!(link.receive(&mut [0; 8], deadline).unwrap(), None);
    assert!(link.now() >= deadline);
    // The board sees no pause that its remotes would take for a broken cable.
    let mut behind = || {
        link.send(&[0x81, 0x42, 0x00, 0x01]).unwrap();
        let mut world = lock(&link.world);
        world.now().saturating_sub(world.board.time())
    };
    let before = behind();
    std::thread::sleep(Duration::from_millis(60));
    assert!(behind() >= before + 50_000_000);
}
