//! The commands, each in its own file or folder: arguments, action and output.

pub mod completion;
mod doctor;
mod flash;
mod hal;
mod info;
mod ip;
mod latency;
mod led;
mod list;
mod manual;
pub mod param;
mod pins;
mod raw;
mod registers;
mod report;
mod restart;
mod scope;
pub mod set;
mod sim;
mod update;
mod watch;
mod wiring;

use clap::Subcommand;

use crate::ui::context::{Context, Ending, Failure};

#[derive(Debug, Subcommand)]
pub enum Command {
    Completions(manual::Completions),
    Doctor(doctor::Doctor),
    Flash(flash::Flash),
    Hal(hal::Hal),
    Info(info::Info),
    Ip(ip::Ip),
    Latency(latency::Latency),
    Led(led::Led),
    List(list::List),
    Man(manual::Man),
    Param(param::Param),
    Peek(registers::Peek),
    Pins(pins::Pins),
    Poke(registers::Poke),
    Raw(raw::Raw),
    Reload(restart::Reload),
    Report(report::Report),
    Reset(restart::Reset),
    Scope(scope::Scope),
    Set(set::Set),
    Sim(sim::Options),
    Update(update::Update),
    Watch(watch::Watch),
    Wiring(wiring::Wiring),
}

/// A group of commands in the help.
pub struct Group {
    pub heading: &'static str,
    /// Names of the commands, in their order.
    pub commands: &'static [&'static str],
}

/// All groups: each command is in exactly one.
pub const GROUPS: [Group; 7] = [
    Group {
        heading: "Look",
        commands: &["list", "info", "pins", "watch", "scope"],
    },
    Group {
        heading: "Test a machine",
        commands: &["doctor", "wiring", "set", "latency"],
    },
    Group {
        heading: "Keep and set up",
        commands: &["report", "hal", "param", "update", "flash", "ip", "led"],
    },
    Group {
        heading: "Restart a board",
        commands: &["reload", "reset"],
    },
    Group {
        heading: "Registers by hand",
        commands: &["peek", "poke", "raw"],
    },
    Group {
        heading: "Simulate",
        commands: &["sim"],
    },
    Group {
        heading: "Shell and manual",
        commands: &["completions", "man"],
    },
];

impl Command {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        match self {
            Self::Hal(hal) => hal.run(context),
            Self::Info(info) => info.run(context),
            Self::Latency(latency) => latency.run(context),
            Self::Led(led) => led.run(context),
            Self::Ip(ip) => ip.run(context),
            Self::Flash(flash) => flash.run(context),
            Self::Doctor(doctor) => doctor.run(context),
            Self::Reload(reload) => reload.run(context),
            Self::Reset(reset) => reset.run(context),
            Self::Completions(completions) => completions.run(context),
            Self::Man(man) => man.run(context),
            Self::Raw(raw) => raw.run(context),
            Self::Peek(peek) => peek.run(context),
            Self::Poke(poke) => poke.run(context),
            Self::List(list) => list.run(context),
            Self::Param(param) => param.run(context),
            Self::Report(report) => report.run(context),
            Self::Pins(pins) => pins.run(context),
            Self::Watch(watch) => watch.run(context),
            Self::Scope(scope) => scope.run(context),
            Self::Set(set) => set.run(context),
            Self::Sim(options) => sim::run(options, context),
            Self::Update(update) => update.run(context),
            Self::Wiring(wiring) => wiring.run(context),
        }
    }
}
