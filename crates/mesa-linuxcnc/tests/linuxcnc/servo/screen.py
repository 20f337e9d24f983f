#!/usr/bin/python3
"""LinuxCNC's screen without a screen: an operator who takes commands on standard input, one a line,
and answers each on file 3 as session.sh of mesa-tools does: its output, messages with `! ` in front,
and a line `= STATUS`.

    on                          resets the emergency stop and switches the machine on
    off                         switches it off
    home JOINT                  homes a joint
    jog JOINT DISTANCE SPEED    moves a joint; prints the following error of each moment
    move JOINT DISTANCE SPEED   begins to move a joint, and does not wait for its end
    joints                      prints the number of joints
    mdi CODE...                 moves with G-code, and ends in the mode for joints
    COMMAND...                  any other command is halcmd's
"""

import os
import subprocess
import sys
import time

import linuxcnc

PATIENCE = 40  # seconds
# LinuxCNC forgets a request that a busy computer lets wait for too long.
REPEAT = 0.5

answers = os.fdopen(3, "w")
command = linuxcnc.command()
stat = linuxcnc.stat()
errors = linuxcnc.error_channel()


def until(what, is_so, request=lambda: None, seconds=PATIENCE):
    end = time.monotonic() + seconds
    again = 0
    while time.monotonic() < end:
        if time.monotonic() >= again:
            request()
            again = time.monotonic() + REPEAT
        stat.poll()
        if is_so():
            return
        time.sleep(0.002)
    raise RuntimeError(f"never: {what}")


def on():
    until(
        "the emergency stop is reset",
        lambda: stat.task_state != linuxcnc.STATE_ESTOP,
        lambda: command.state(linuxcnc.STATE_ESTOP_RESET),
    )
    until(
        "the machine is on",
        lambda: stat.task_state == linuxcnc.STATE_ON,
        lambda: command.state(linuxcnc.STATE_ON),
    )
    until(
        "the mode is manual, for joints",
        lambda: stat.task_mode == linuxcnc.MODE_MANUAL
        and stat.motion_mode == linuxcnc.TRAJ_MODE_FREE,
        lambda: (command.mode(linuxcnc.MODE_MANUAL), command.teleop_enable(0)),
    )


def off():
    until(
        "the machine is off",
        lambda: stat.task_state == linuxcnc.STATE_ESTOP_RESET,
        lambda: command.state(linuxcnc.STATE_OFF),
    )


def home(joint):
    joint = int(joint)
    command.home(joint)
    until(f"joint {joint} is homed", lambda: stat.homed[joint] and stat.joint[joint]["inpos"])
    # A jog is refused until LinuxCNC's thread has seen that it homes no joint any more.
    until("no joint is homing", lambda: not any(one["homing"] for one in stat.joint[: stat.joints]))
    time.sleep(0.05)


def jog(joint, distance, speed):
    joint, distance = int(joint), float(distance)
    stat.poll()
    end = stat.joint[joint]["output"] + distance
    found = []

    def is_there():
        now = stat.joint[joint]
        if now["velocity"] != 0:
            found.append(now["ferror_current"])
        return now["inpos"] and abs(now["output"] - end) < 1e-6

    command.jog(linuxcnc.JOG_INCREMENT, True, joint, float(speed), distance)
    until("the joint is there", is_there)
    return " ".join(map(str, found))


def move(joint, distance, speed):
    joint = int(joint)
    command.jog(linuxcnc.JOG_INCREMENT, True, joint, float(speed), float(distance))
    until("the joint moves", lambda: abs(stat.joint[joint]["velocity"]) > 0.9 * float(speed))


def joints():
    stat.poll()
    return str(stat.joints)


def mdi(*words):
    until(
        "the mode is that for G-code",
        lambda: stat.task_mode == linuxcnc.MODE_MDI,
        lambda: command.mode(linuxcnc.MODE_MDI),
    )
    command.mdi(" ".join(words))
    done = command.wait_complete(PATIENCE)
    if done != linuxcnc.RCS_DONE:
        raise RuntimeError(f"{words} ends with {done}")
    until("the machine stands", lambda: stat.inpos and stat.interp_state == linuxcnc.INTERP_IDLE)
    on()


def halcmd(*words):
    done = subprocess.run(["halcmd", *words], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return done.stdout.strip()


def answer(words):
    own = {"on": on, "off": off, "home": home, "jog": jog, "move": move, "joints": joints, "mdi": mdi}
    own = own.get(words[0])
    return own(*words[1:]) if own else halcmd(*words)


for line in sys.stdin:
    status = 0
    try:
        said = answer(line.split())
        if said:
            print(said, file=answers)
    except Exception as error:
        status = 1
        print("!", " ".join(str(error).split()), file=answers)
    while message := errors.poll():
        print("!", " ".join(message[1].split()), file=answers)
    print(f"= {status}", file=answers, flush=True)
