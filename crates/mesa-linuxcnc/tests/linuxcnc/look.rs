//! A look at the board beside the component, from the computer that LinuxCNC runs on.

use std::path::Path;
use std::process::Stdio;

use super::halcmd::{alone, skipped};
use super::passive::{Look, compare_errors};
use super::session::{Session, built};

/// Unlike hm2_eth, the component lets other programs out to its board. The limits of a look are
/// tested in `mesa-tools`, beside the driver in virtual time and beside hm2_eth.
#[test]
fn look_costs_the_component_no_packet_and_is_no_second_master() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mesa = built("../mesa");
    let mut session = Session::load("mesa_eth");
    session.run();
    session.switch_on();
    let info = look(&session, &mesa, &["info", "--passive"]);
    assert!(info.contains("MESA7I97"), "{info}");
    let peek = look(&session, &mesa, &["peek", "encoder.00.count"]);
    assert!(peek.contains("encoder.00.count"), "{peek}");
    compare_errors(&mut session, &mesa);
    for name in ["valid", "7i77.0.0.valid", "7i72.0.2.valid"] {
        session.expect(name, "TRUE");
    }
    session.expect_outputs([true; 3]);
    let report = "hm2_7i97.0: another program drives this board";
    let is_reported = |session: &Session| session.messages.iter().any(|said| said.contains(report));
    assert!(!is_reported(&session), "{:?}", session.messages);
    // So many looks at a time send more than 50 packets a second.
    let looks = [(); 6].map(|()| Look::start(&session, &mesa, Stdio::null()));
    session.until("a second master", |session| {
        session.hal("list comp");
        is_reported(session)
    });
    drop(looks);
    session.stop();
}

/// What a command of `mesa` prints about the board.
fn look(session: &Session, mesa: &Path, arguments: &[&str]) -> String {
    let mut command = session.beside(mesa);
    command.args(arguments).args(["--addr", "10.97.0.2"]);
    let output = command.output().expect("mesa starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}
