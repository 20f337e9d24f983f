//! LinuxCNC on the same computer blocks other programs' access to its board with a firewall chain
//! of its driver hm2_eth. Runs in a private network, with the rules as the driver leaves them.

use std::process::{Command, Output, Stdio};

use crate::interop::mesa;
use crate::interop::tools::{has_program, skip};

/// The interface of the board exists, with a link and an address, and no board answers; then the
/// rules, and each command. At the end without the rules.
const SESSION: &str = r#"
mount -t sysfs sysfs /sys
ip link set lo up
ip link add pc0 type veth peer name board0
ip addr add 10.97.0.1/24 dev pc0
ip link set pc0 up
ip link set board0 up
iptables -N hm2-eth-rules-output
iptables -I OUTPUT 1 -j hm2-eth-rules-output
iptables -A hm2-eth-rules-output -o pc0 -j REJECT --reject-with icmp-admin-prohibited
commands() {
  echo "== list"; $MESA list 10.97.0.2 2>&1 | sed -n '/^10.97.0.2/,$p'
  echo "== info"; $MESA info --addr 10.97.0.2 2>&1
  echo "== raw"; $MESA raw 01420001 --addr 10.97.0.2 2>&1
  echo "== doctor"; $MESA doctor --passive --addr 10.97.0.2 2>&1 | grep -A1 'board:'
}
commands
iptables -F hm2-eth-rules-output
echo "=== free"
commands
"#;

fn private(session: &str) -> Output {
    let mut command = Command::new("unshare");
    command.args(["--net", "--mount", "bash", "-c", session]);
    command.env("MESA", mesa()).env_remove("MESA_ADDR");
    command.stdin(Stdio::null()).output().expect("unshare runs")
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn linuxcnc_firewall_is_named_and_no_network_change_advised() {
    for program in ["unshare", "ip", "iptables"] {
        if !has_program(program) {
            return skip(program);
        }
    }
    let rights = "ip link add one type veth peer name two && iptables -S";
    if !private(rights).status.success() {
        return skip("no right to make a private network and its firewall");
    }
    let output = private(SESSION);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let (blocked, free) = text.split_once("=== free\n").expect("both");
    for part in blocked.split("== ").skip(1) {
        assert!(part.contains("blocks packets to this address"), "{part}");
        assert!(
            part.contains("LinuxCNC on this computer keeps its board for itself: end it"),
            "{part}"
        );
        assert!(
            part.contains("sudo iptables -F hm2-eth-rules-output"),
            "{part}"
        );
        assert!(!part.contains("ip addr add"), "{part}");
        assert!(!part.contains("no route to"), "{part}");
    }
    assert_eq!(blocked.matches("== ").count(), 4, "{blocked}");
    // Without the rules LinuxCNC is not named as the cause.
    assert!(!free.contains("LinuxCNC"), "{free}");
    let silent = "10.97.0.2        no answer on pc0, which is in its network";
    assert!(free.contains(silent), "{free}");
    assert!(free.contains("no board answers"), "{free}");
}
