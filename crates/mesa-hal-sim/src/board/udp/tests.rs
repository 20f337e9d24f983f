use core::net::Ipv4Addr;

use super::*;
use crate::{BoardConfig, machines};

const COOKIE: [u8; 4] = [0xFE, 0xCA, 0xAA, 0x55];
const ASK_COOKIE: [u8; 4] = [0x01, 0x42, 0x00, 0x01];

struct Pair {
    face: UdpFace,
    board: SimBoard<crate::SimFpga>,
    client: UdpSocket,
}

impl Pair {
    fn new(mishaps: Mishaps) -> Self {
        let face = UdpFace::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0), mishaps).unwrap();
        let client = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        client.connect(face.local_addr().unwrap()).unwrap();
        client.set_nonblocking(true).unwrap();
        let board = SimBoard::new(BoardConfig::new("7I97"), machines::i7i97(1));
        Self {
            face,
            board,
            client,
        }
    }

    /// Steps until a reply arrives, or the time is over.
    fn reply(&mut self, patience: Duration) -> Option<(Vec<u8>, Duration)> {
        let start = Instant::now();
        let mut buffer = [0; 2048];
        while start.elapsed() < patience {
            let step = Duration::from_micros(100);
            self.face.step(&mut self.board, step).unwrap();
            if let Ok(len) = self.client.recv(&mut buffer) {
                return Some((buffer[..len].to_vec(), start.elapsed()));
            }
        }
        None
    }
}

/// Long enough for a busy computer: a reply that is there ends the wait.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn client_gets_its_answers_over_a_real_socket() {
    let mut pair = Pair::new(Mishaps::default());
    for _ in 0..20 {
        pair.client.send(&ASK_COOKIE).unwrap();
        assert_eq!(pair.reply(PATIENCE).unwrap().0, COOKIE);
    }
    assert_eq!(pair.face.received().packets, 20);
    assert_eq!((pair.face.sent().packets, pair.face.sent().bytes), (20, 80));
}

#[test]
fn clients_are_listed_and_the_longest_silent_one_is_dropped() {
    let Pair {
        mut face, client, ..
    } = Pair::new(Mishaps::default());
    let peer = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    for (now, port) in (1..=8)
        .map(|n| (u64::from(n), n))
        .chain([(9, 1), (10, 100)])
    {
        face.heard(now, peer(port), port == 1);
    }
    let mut ports: Vec<_> = face.clients().iter().map(|c| c.address.port()).collect();
    ports.sort_unstable();
    assert_eq!(ports, [1, 3, 4, 5, 6, 7, 8, 100]);
    let first = face.clients().iter().find(|c| c.address == peer(1));
    assert_eq!(
        first.map(|c| (c.packets, c.writes, c.heard)),
        Some((2, 2, 9))
    );

    let mut pair = Pair::new(Mishaps::default());
    pair.client.send(&ASK_COOKIE).unwrap();
    pair.reply(PATIENCE).unwrap();
    let address = pair.client.local_addr().unwrap();
    assert_ne!(Some(address), client.local_addr().ok());
    let heard: Vec<_> = pair
        .face
        .clients()
        .iter()
        .map(|c| (c.address, c.packets))
        .collect();
    assert_eq!(heard, [(address, 1)]);
}

#[test]
fn reply_waits_while_the_board_waits() {
    let mut pair = Pair::new(Mishaps::default());
    // WaituS 20000, then the cookie; and a second request behind it.
    pair.client
        .send(&[0x01, 0xD1, 0x02, 0x00, 0x20, 0x4E, 0x01, 0x42, 0x00, 0x01])
        .unwrap();
    pair.client.send(&ASK_COOKIE).unwrap();
    let (reply, waited) = pair.reply(PATIENCE).unwrap();
    assert_eq!(reply, COOKIE);
    assert!(waited >= Duration::from_millis(19), "{waited:?}");
    assert_eq!(pair.reply(PATIENCE).unwrap().0, COOKIE);
}

#[test]
fn lost_and_duplicate_packets_are_counted() {
    let all = |loss, dup| Mishaps {
        loss,
        dup,
        ..Mishaps::default()
    };
    let mut pair = Pair::new(all(1.0, 0.0));
    pair.client.send(&ASK_COOKIE).unwrap();
    assert_eq!(pair.reply(Duration::from_millis(20)), None);
    assert_eq!(
        (pair.face.received().lost, pair.face.sent().packets),
        (1, 0)
    );

    let mut pair = Pair::new(all(0.0, 1.0));
    pair.client.send(&ASK_COOKIE).unwrap();
    for _ in 0..4 {
        assert_eq!(pair.reply(PATIENCE).unwrap().0, COOKIE);
    }
    assert_eq!(pair.face.received().duplicate, 1);
    assert_eq!(pair.face.sent().duplicate, 2);
}

#[test]
fn late_packets_come_late() {
    let mut pair = Pair::new(Mishaps {
        late: 1.0,
        ..Mishaps::default()
    });
    pair.client.send(&ASK_COOKIE).unwrap();
    let (_, waited) = pair.reply(PATIENCE).unwrap();
    assert!(waited >= Duration::from_millis(1), "{waited:?}");
    assert_eq!((pair.face.received().late, pair.face.sent().late), (1, 1));
}

#[test]
fn late_request_does_not_spin_the_loop_while_the_board_waits() {
    let Pair { mut face, .. } = Pair::new(Mishaps::default());
    let peer = face.local_addr().unwrap();
    face.hold(1_000, peer, false, &ASK_COOKIE);
    assert_eq!(face.next_event(9_000, None), 1_000);
    assert_eq!(face.next_event(9_000, Some(5_000)), 5_000);
    face.hold(2_000, peer, true, &COOKIE);
    assert_eq!(face.next_event(9_000, Some(5_000)), 2_000);
    assert_eq!(face.next_event(500, Some(5_000)), 500);
}

#[test]
fn same_seed_throws_the_same_dice() {
    let rolls = |seed| {
        let mut dice = Dice(seed);
        (0..1000).map(|_| dice.hit(0.1)).collect::<Vec<_>>()
    };
    assert_eq!(rolls(7), rolls(7));
    assert_ne!(rolls(7), rolls(8));
    let hits = rolls(7).iter().filter(|&&hit| hit).count();
    assert!((60..140).contains(&hits), "{hits}");
    assert!(!(0..1000).any(|seed| Dice(seed).hit(0.0)));
    assert!((0..1000).all(|seed| Dice(seed).hit(1.0)));
}
