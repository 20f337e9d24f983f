//! LinuxCNC's names and those of `mesa-hal` agree for public firmwares of six different boards,
//! which the simulated board runs.

use mesa_eth::Config;
use mesa_hal::driver::Driver;
use mesa_hal_sim::{FirmwareImage, SimFpga, machines};

use super::expected::Expected;
use super::linuxcnc::{Machine, alone, skipped};
use super::names;

/// Image, and the prefix of LinuxCNC's names.
const FIRMWARES: [(&str, &str); 6] = [
    ("7I92-7I76x2D_34", "hm2_7i92.0"),
    ("7I97-7I97_7I76D_51", "hm2_7i97.0"),
    ("7I96S-7I96S_G540D", "hm2_7i96s.0"),
    ("7I95-7I95_1PktD_58", "hm2_7i95.0"),
    ("7I76E-7I76x1_BSTECHx2D_51", "hm2_7i76e.0"),
    ("7I93-RLUKEN_48", "hm2_7i93.0"),
];

/// A serial port without any remote has no names in LinuxCNC.
const REMOTE: &str = "
pin bit IN 7i72.0.0.output-{NN} 48
param u32 RW watchdog.timeout_ns
";

/// Packet UARTs are not driven: without them LinuxCNC has their pins as plain I/O as well.
const CONFIG: &str = "num_pktuarts=0 sserial_port_0=0xxxxxxx";

#[test]
fn six_public_firmwares_have_the_names_that_linuxcnc_gives_them() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let expected = Expected::of(&[REMOTE]);
    for (name, prefix) in FIRMWARES {
        let directory = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../tests/transcripts/firmwares"
        );
        let path = format!("{directory}/{name}.txt");
        let board = format!("--firmware {path} --remote 0=7i72");
        let how = ("loadrt hostmot2", CONFIG);
        let mut machine = Machine::load_all(prefix, (name, &board), &expected, how);
        let text = std::fs::read_to_string(&path).expect("an image");
        let image = FirmwareImage::parse(&text).expect("an image");
        let mut fpga = SimFpga::from_image(&image).expect("a firmware");
        machines::plug_7i72(&mut fpga, 0, 0);
        let settings = Config::parse(CONFIG).expect("words of LinuxCNC").settings;
        let driver = Driver::start(fpga, settings).expect("it starts");
        let (pins, params) = (machine.list("pin"), machine.list("param"));
        names::compare(prefix, [&pins, &params], driver.pins(), 150);
        names::compare_values(prefix, &machine.values(), driver.pins(), 50);
        machine.stop();
    }
}
