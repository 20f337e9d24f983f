//! The names of modules and pins, written out from the constants of Mesa's public VHDL sources
//! (`IDROMConst.vhd`), each with its name in the crate.

/// Names of module tags.
const MODULES: &str = "02 Watchdog,03 IOPort,04 Encoder,05 StepGen,06 PWM,07 SPI,08 SSI,\
09 UARTTransmit,0A UARTReceive,0B TranslationRAM,0C MuxedEncoder,0D MuxSelect,0E BSPI,0F DBSPI,\
10 DPLL,11 MuxedEncoderMIM,12 MuxSelectMIM,13 ThreePhasePWM,14 WaveGen,15 DAQFIFO,16 BinOsc,\
17 DMDMA,18 BISS,19 FABS,1A HM2DPLL,1B PktUARTTransmit,1C PktUARTReceive,1D ScalerCounter,1E InMux,\
23 InM,2A DPainter,2B XY2Mod,2C RCPWM,2D OutM,80 LED,C0 Resolver,C1 SSerial,C2 Twiddler,C3 SSR,\
C4 CPDrive,C5 DSAD,C6 SSerialB,C7 OneShot,C8 Period";

/// Names of single secondary pins, by the tags of their modules.
const PINS: &[(&str, &str)] = &[
    (
        "04 0C 11",
        "01 A,02 B,03 Index,04 IndexMask,05 Probe,06 SharedIndex",
    ),
    (
        "05",
        "81 Step,82 Dir,83 Table2,84 Table3,85 Table4,86 Table5,87 Table6,88 Table7",
    ),
    ("05", "09 Index,0A Probe,01 Index,02 Probe"),
    ("06", "81 Out,82 Dir,83 /Enable"),
    ("07 0E 0F", "81 Frame,82 Out,83 Clk,04 In"),
    ("08", "81 Clk,82 ClkEn,03 Data,84 DataValid,85 /ClkEn"),
    ("09 1B", "81 TX,82 TXEN,83 /TXEN"),
    ("0A 1C", "01 RX"),
    ("0D 12", "81 Select0,82 Select1"),
    ("13", "81 A,82 B,83 C,84 /A,85 /B,86 /C,87 Enable,08 Fault"),
    (
        "14",
        "81 PDMA,82 PDMB,83 Trigger0,84 Trigger1,85 Trigger2,86 Trigger3",
    ),
    (
        "18",
        "81 Clk,82 ClkEn,03 Data,84 DataValid,85 TestData,86 SampleTime,87 /ClkEn",
    ),
    (
        "19",
        "81 Request,82 RequestEn,03 Data,84 DataValid,85 TestClk,86 /RequestEn",
    ),
    (
        "1A",
        "01 Sync,82 Ref,83 Timer1,84 Timer2,85 Timer3,86 Timer4",
    ),
    ("1D", "01 A,02 B"),
    ("1E", "01 Data,81 Addr0,82 Addr1,83 Addr2,84 Addr3,85 Addr4"),
    ("2A", "81 Data,82 Clk"),
    ("2B", "81 DataX,82 DataY,83 Clk,84 Sync,05 Status"),
    ("2C", "81 Out"),
    (
        "C0",
        "81 PowerEnable,82 PDM+,83 PDM-,84 Channel0,85 Channel1,86 Channel2,87 SPICS",
    ),
    ("C0", "88 SPIClk,89 Test,09 SPIIn0,0A SPIIn1"),
    ("15", "41 Strobe,81 Full"),
    ("C3", "A0 ACRef"),
    ("C4", "81 High,82 Low"),
    ("C5", "90 PWM"),
    ("C7", "01 Trigger1,02 Trigger2,83 Out1,84 Out2"),
    ("C8", "01 In"),
];

/// Names of rows of pins: tags, first, last, name before the number.
const ROWS: &[(&str, u8, u8, &str)] = &[
    ("0E 0F", 0x85, 0x8C, "CS"),
    ("15", 0x01, 0x1F, "Data"),
    ("16", 0x81, 0x9F, "Out"),
    ("23", 0x01, 0x20, "In"),
    ("2D C3", 0x81, 0x9F, "Out"),
    ("C1 C6", 0x01, 0x0F, "RX"),
    ("C1 C6", 0x81, 0x8F, "TX"),
    ("C1 C6", 0x91, 0x9F, "TXEN"),
    ("C1 C6", 0xA1, 0xAF, "/TXEN"),
    ("C2", 0x01, 0x1F, "In"),
    ("C2", 0x81, 0x9F, "Out"),
    ("C2", 0xC1, 0xDF, "IO"),
    ("C5", 0x01, 0x0F, "Compare+"),
    ("C5", 0x11, 0x1F, "Compare-"),
    ("C5", 0x81, 0x8F, "Feedback"),
];

/// Tags of modules in sources of 2016 whose meaning is not known. Later sources use them for hints.
pub const UNKNOWN: [u8; 4] = [0x1F, 0x20, 0x21, 0x22];

fn entry(list: &str, number: u8) -> Option<&str> {
    let mut entries = list.split(',').map(|entry| entry.split_at(3));
    entries
        .find_map(|(hex, name)| (u8::from_str_radix(hex.trim(), 16) == Ok(number)).then_some(name))
}

fn has(tags: &str, tag: u8) -> bool {
    let mut tags = tags.split(' ');
    tags.any(|text| u8::from_str_radix(text, 16) == Ok(tag))
}

/// The name of a kind of module.
pub fn module(tag: u8) -> Option<&'static str> {
    entry(MODULES, tag)
}

/// The name of a pin of a module.
pub fn pin(tag: u8, pin: u8) -> Option<String> {
    let mut single = PINS.iter().filter(|(tags, _)| has(tags, tag));
    let single = single.find_map(|(_, list)| entry(list, pin));
    let mut rows = ROWS.iter();
    let row = rows.find(|(tags, first, last, _)| has(tags, tag) && (*first..=*last).contains(&pin));
    let of_row = row.map(|(_, first, _, name)| format!("{name}{}", pin - first));
    single.map(str::to_owned).or(of_row)
}
