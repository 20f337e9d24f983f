use super::*;
use mesa_hal::{Board, Settings};
use mesa_hal_sim::{Motor, machines};

fn board() -> Configured<mesa_hal_sim::SimFpga> {
    let bus = machines::six_axes_7i92(Motor::default());
    let board = Board::identify(bus, Settings::default()).unwrap();
    board.discover().unwrap()
}

#[test]
fn cabinet_parameters_are_saved_compared_and_restored() {
    let mut board = board();
    let saved = SavedCabinet::take(&mut board).unwrap();
    let cards: Vec<_> = saved
        .remotes
        .iter()
        .map(|r| (&*r.place, &*r.card))
        .collect();
    assert_eq!(cards, [("0.0", "7I77"), ("0.1", "7I77"), ("0.2", "7I72")]);
    let kept = &saved.remotes[0].parameters;
    assert_eq!(kept["NVWatchDogTimeout"], SavedValue::Whole(50));
    assert!(!kept.contains_key("SwRevision"), "read-only");
    let same = saved.compare(&mut board, RemoteMatch::UnitNumber).unwrap();
    assert_eq!(same.differences, []);
    assert_eq!(same.compared, 7, "two, two and three parameters are kept");

    let place = RemotePlace::Channel(RemoteId::new(0, 0));
    let name = "NVWatchDogTimeout";
    board.write(place, name, 80_u32.into()).unwrap();
    let found = saved.compare(&mut board, RemoteMatch::UnitNumber).unwrap();
    let [difference] = &found.differences[..] else {
        panic!("{found:?}");
    };
    assert_eq!((difference.place, &*difference.name), (place, name));
    let values = (difference.saved, difference.now);
    assert_eq!(values, (SavedValue::Whole(50), SavedValue::Whole(80)));
    difference.restore(&mut board).unwrap();
    assert_eq!(board.read(place, name).unwrap(), 50);
}

#[test]
fn file_for_other_cards_is_refused_unless_matched_by_place() {
    let mut board = board();
    let mut saved = SavedCabinet::take(&mut board).unwrap();
    saved.remotes[2].unit_number ^= 1;
    let refused = saved.compare(&mut board, RemoteMatch::UnitNumber);
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("7I72"), "{refused}");
    saved.compare(&mut board, RemoteMatch::Place).unwrap();
    saved.remotes[2].card = "7I64".into();
    let refused = saved.compare(&mut board, RemoteMatch::Place);
    assert!(matches!(refused, Err(RestoreError::Missing { .. })));
    saved.remotes.pop();
    let fewer = saved.compare(&mut board, RemoteMatch::UnitNumber).unwrap();
    assert_eq!(
        fewer.not_in_file,
        [RemotePlace::Channel(RemoteId::new(0, 2))]
    );
}

#[test]
fn file_with_values_that_do_not_fit_is_refused_before_a_write() {
    let mut board = board();
    let saved = SavedCabinet::take(&mut board).unwrap();
    for (name, value) in [
        ("NVBaudRate", SavedValue::Whole(65_536)),
        ("NVWatchDogTimeout", SavedValue::Whole(-1)),
        ("NVWatchDogTimeout", SavedValue::Real(0.5)),
        ("NVNothing", SavedValue::Whole(1)),
    ] {
        let mut spoilt = saved.clone();
        let kept = &mut spoilt.remotes[0].parameters;
        kept.insert("NVWatchDogTimeout".into(), SavedValue::Whole(60));
        kept.insert(name.into(), value);
        let refused = spoilt.compare(&mut board, RemoteMatch::UnitNumber);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains(name), "{refused}");
    }
    let newer = SavedCabinet { format: 2, ..saved };
    let refused = newer.compare(&mut board, RemoteMatch::UnitNumber);
    assert!(matches!(refused, Err(RestoreError::Format { found: 2 })));
}

#[test]
fn numbers_are_read_as_people_write_them() {
    assert_eq!(parse_value("100"), Ok(100_u64.into()));
    assert_eq!(parse_value("0xFF"), Ok(255_u64.into()));
    assert_eq!(parse_value("-3"), Ok((-3_i64).into()));
    assert_eq!(parse_value("2.5"), Ok(2.5.into()));
    for text in [
        "",
        "0x",
        "inf",
        "nan",
        "ten",
        "1e999",
        "0x1FFFFFFFFFFFFFFFF",
    ] {
        assert_eq!(parse_value(text), Err(text));
    }
}
