//! `motion.hal`: LinuxCNC's motion, servo loops, step generators and emergency stop.

use std::fmt::Write;

use super::super::Component;
use super::super::machine::{Joint, Machine, Servo, Stepper};
use super::parts::Parts;
use super::prepared::{self, Terminals};
use super::{LOOP, estop, signal};

/// LinuxCNC's motion on the signals of `board.hal`, which is read before it: every pin of the board
/// is there, and every line works where it stands.
pub fn motion(machine: &Machine, component: Component) -> String {
    let mut terminals = Terminals::of(machine);
    let mut parts = Parts::default();
    let chain = estop::chain(machine, component, &mut parts, &mut terminals);
    let mut text = heading(machine);
    text += &loads(machine, &parts);
    text += &chain;
    text += "\n# Tools are changed by hand.\n\
             net tool-prepare <= iocontrol.0.tool-prepare => iocontrol.0.tool-prepared\n\
             net tool-change <= iocontrol.0.tool-change => iocontrol.0.tool-changed\n";
    for (number, joint) in machine.joints.iter().enumerate() {
        text += &match joint {
            Joint::Servo(joint) => servo(machine, number, joint),
            Joint::Stepper(joint) => stepper(machine, number, joint),
        };
    }
    if machine.joints.is_empty() {
        text += "\n# TODO: no encoder with an analog output and no step generator was found. The feedback of a joint is its command.\n";
        for number in 0..machine.letters.len() {
            let _ = write!(
                text,
                "net joint-{number}-enable <= joint.{number}.amp-enable-out\n\
                 net joint-{number}-command <= joint.{number}.motor-pos-cmd => joint.{number}.motor-pos-fb\n"
            );
        }
    }
    text + &prepared::lines(machine, &mut terminals)
}

fn heading(machine: &Machine) -> String {
    format!(
        "# LinuxCNC's motion, servo loops and emergency stop, on the signals of board.hal ({}), which is read\n\
         # before this file. Written by `mesa hal`.\n",
        machine.board
    )
}

/// The realtime parts, and all functions of the thread: the board is read first and written last.
fn loads(machine: &Machine, parts: &Parts) -> String {
    let Machine { board, joints, .. } = machine;
    let servos = joints
        .iter()
        .filter(|joint| joint.servo().is_some())
        .count();
    let mut text = String::from(
        "\nloadrt [KINS]KINEMATICS\n\
         loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS\n",
    );
    if servos > 0 {
        text += "loadrt pid num_chan=[KINS]JOINTS\n";
    }
    text += &parts.loads();
    let _ = write!(
        text,
        "\n# In this order: the board is read before everything else, and written after it.\n\
         addf {board}.read servo-thread\n\
         addf motion-command-handler servo-thread\n\
         addf motion-controller servo-thread\n"
    );
    for number in 0..servos {
        let _ = writeln!(text, "addf pid.{number}.do-pid-calcs servo-thread");
    }
    text += &parts.functions();
    let _ = writeln!(text, "addf {board}.write servo-thread -1");
    text
}

/// The servo loop of a joint.
fn servo(machine: &Machine, number: usize, joint: &Servo) -> String {
    let encoder = signal(machine, &joint.encoder);
    let volts = signal(machine, &joint.volts);
    let mut text = format!("\n# Joint {number}: {encoder}, {volts}\n");
    for (name, parameter, _) in LOOP {
        let _ = writeln!(text, "setp pid.{number}.{parameter} [JOINT_{number}]{name}");
    }
    let _ = write!(
        text,
        "net joint-{number}-enable <= joint.{number}.amp-enable-out => pid.{number}.enable\n\
         net joint-{number}-command <= joint.{number}.motor-pos-cmd => pid.{number}.command\n\
         net {encoder}-position => joint.{number}.motor-pos-fb pid.{number}.feedback\n\
         net {encoder}-velocity => pid.{number}.feedback-deriv\n\
         net {encoder}-index-enable <=> joint.{number}.index-enable pid.{number}.index-enable\n\
         net {volts} <= pid.{number}.output\n"
    );
    text
}

/// The step generator of a joint, which follows positions.
fn stepper(machine: &Machine, number: usize, joint: &Stepper) -> String {
    let stepgen = signal(machine, &joint.stepgen);
    let mut text = format!(
        "\n# Joint {number}: {stepgen}\n\
         net joint-{number}-enable <= joint.{number}.amp-enable-out\n\
         net {stepgen}-position-cmd <= joint.{number}.motor-pos-cmd\n\
         net {stepgen}-position-fb => joint.{number}.motor-pos-fb\n"
    );
    if joint.has_index {
        let _ = writeln!(
            text,
            "net {stepgen}-index-enable <=> joint.{number}.index-enable"
        );
    }
    text
}
