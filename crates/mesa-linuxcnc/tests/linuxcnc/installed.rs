//! What is installed stays as it is: a LinuxCNC that runs on this computer uses it.

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use super::halcmd::skipped;
use super::session::built;

/// Content, mode and time of each file of a folder.
fn files_of(folder: &Path) -> BTreeMap<PathBuf, (Vec<u8>, u32, SystemTime)> {
    let entries = fs::read_dir(folder).expect("a folder");
    let files = entries.map(|entry| {
        let path = entry.expect("an entry").path();
        let content = fs::read(&path).expect("a file");
        let data = path.metadata().expect("a file");
        let time = data.modified().expect("a time");
        (path, (content, data.permissions().mode(), time))
    });
    files.collect()
}

/// In the namespace of `with_component.sh`: prints the names of the tested component, and tries to
/// change each installed module.
const HOSTILE: &str = r#"
for module in "$0"/*.so; do
  cmp --silent "$module" "$1" && echo "$(basename "$module")"
  [ ! -L "$module" ] || { echo spoiled > "$module" || chmod a+w "$module"; } 2> /dev/null
done
exit 0
"#;

/// The folder of modules is a copy, in a mount namespace.
#[test]
fn installed_component_is_never_written() {
    if skipped() {
        return;
    }
    let name = format!("installed-{}", std::process::id());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    for module in ["mesa_eth.so", "mesa_pci.so", "threads.so"] {
        let path = folder.join(module);
        fs::write(&path, format!("installed {module}")).expect("a file");
        fs::set_permissions(&path, Permissions::from_mode(0o640)).expect("a mode");
    }
    let before = files_of(&folder);
    let script = r#"
        set -e
        modules=$(sed -n 's/^RTLIBDIR *:\?= *//p' /usr/share/linuxcnc/Makefile.modinc | tail -1)
        mount --bind "$0" "${modules:=/usr/lib/linuxcnc/modules}"
        "$1" "$2" bash -c "$3" "$modules" "$2"
    "#;
    let mut sandbox = Command::new("unshare");
    sandbox
        .args(["--mount", "bash", "-c", script])
        .arg(&folder)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/linuxcnc/with_component.sh"))
        .arg(built("libmesa_eth.so"))
        .arg(HOSTILE);
    let output = sandbox.output().expect("unshare runs");
    let after = files_of(&folder);
    let _ = fs::remove_dir_all(&folder);
    assert!(output.status.success(), "{output:?}");
    let ours = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(
        ours, "mesa_eth.so\nmesa_pci.so\n",
        "they are the tested one"
    );
    assert!(before == after, "{:?}", after.keys());
}
