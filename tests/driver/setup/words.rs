//! Words of LinuxCNC's `config=` for modules that this crate does not drive: without effect where
//! the firmware has none of them, as in hm2_eth, and refused with a sentence where it has.

use mesa_eth::Config;
use mesa_hal::Board;
use mesa_hal::driver::{Driver, RemarkKind};
use mesa_hal_sim::{FirmwareImage, SimFpga};

macro_rules! firmware {
    ($name:literal) => {
        include_str!(concat!("../../transcripts/firmwares/", $name, ".txt"))
    };
}

/// Words of each kind, and a firmware that has the modules.
const WORDS: [(&str, &str); 8] = [
    (
        "num_resolvers=3",
        firmware!("5I23-RMSVSS6_6_6_7I49_7I52_72"),
    ),
    ("num_pktuarts=1", firmware!("7I95-7I95_1PktD_58")),
    ("num_pktuarts=2", firmware!("5I25-PktUART1inst_34-2016")),
    ("num_uarts=2", firmware!("5I25-UA2_34")),
    ("num_xy2mods=1", firmware!("7I92-7I76XY2Modx1D_34")),
    ("biss_chan_0=p%16u", firmware!("7I94-7I94BISSD_42")),
    ("ssi_chan_0=p%16u", firmware!("7I92-7I74_SSI_SSx2_34")),
    ("num_3pwmgens=1", firmware!("5I24-SSSVTP8_4_7I39_72")),
];

/// A firmware without all of these.
const PLAIN: &str = firmware!("7I96S-7I96S_G540D");

fn started(firmware: &str, config: &str) -> Result<Driver<SimFpga>, String> {
    let image = FirmwareImage::parse(firmware).expect("an image");
    let fpga = SimFpga::from_image(&image).expect("a firmware");
    let config = Config::parse(config).map_err(|error| error.to_string())?;
    let board = Board::identify(fpga, config.settings.clone()).expect("a board");
    let checked = config.check(board.firmware());
    checked.map_err(|error| error.to_string())?;
    Ok(board.start().expect("a complete board"))
}

fn names(driver: &Driver<SimFpga>) -> Vec<String> {
    let infos = driver.pins().infos().iter();
    infos.map(|info| info.name.clone()).collect()
}

#[test]
fn words_of_modules_that_are_not_there_change_nothing() {
    let expected = names(&started(PLAIN, "").expect("no word"));
    let more = [
        "num_rcpwmgens=6",
        "num_bspis=2",
        "num_oneshots=1",
        "num_periodms=1",
    ];
    let more = more
        .into_iter()
        .chain(["fanuc_chan_0=p%16u", "num_3pwmgens=0x1"]);
    for word in WORDS.iter().map(|(word, _)| *word).chain(more) {
        let driver = started(PLAIN, word).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(names(&driver), expected, "{word}");
        assert_eq!(driver.remarks().len(), 0, "{word}");
    }
}

#[test]
fn words_of_modules_that_cannot_be_driven_are_refused_by_name() {
    for (word, firmware) in WORDS {
        let error = started(firmware, word).expect_err(word);
        let quoted = format!("'{word}'");
        assert!(
            error.contains(&quoted) && error.contains("does not drive"),
            "{error}"
        );
        let name = word.split('=').next().expect("a name");
        for nothing in ["", &format!("{name}=0"), &format!("{name}=-1")] {
            if nothing.starts_with("num_") || nothing.is_empty() {
                let driver = started(firmware, nothing).expect("it loads");
                let mut remarks = driver.remarks().iter();
                let says = |kind: &RemarkKind| matches!(kind, RemarkKind::Undriven(_));
                assert!(remarks.any(|remark| says(&remark.kind)), "{word}");
            }
        }
    }
}
