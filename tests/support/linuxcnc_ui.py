"""What LinuxCNC starts in place of a screen: it moves the simulated machine as task.json says and writes down values of pins.

This file runs under the interpreter that LinuxCNC's own modules belong to, outside the tests and outside volid. task.json holds

    {"steps": [{"mdi": "G53 G1 X10.0 F6000"}, {"home": true}, …], "pins": ["joint.0.motor-pos-cmd", …], "seconds": 40,
     "owner": number of the process without which all of it ends}

and answer.json, written when all is done, {"rows": [[value of each pin after each step] …], "messages": [what LinuxCNC said],
"error": …}.
A step may also have {"set": {"matrixkins.C_xy": 1e-3}} (halcmd setp; "after": the same once it has moved), {"wait": seconds}.
"""

import json
import os
import sys
import threading
import time

import hal
import linuxcnc

STILL, ATTEMPTS = 8, 2000  # equal readings in a row, 4 ms apart, mean that the ramp at reversal has ended


class Screen:
    """The connection to a running LinuxCNC."""

    def __init__(self, pins, seconds):
        self.status, self.command, self.errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()
        self.pins, self.end, self.messages = pins, time.monotonic() + seconds, []
        self.component = hal.component("screen")  # without one of its own a program may not read pins
        self.component.ready()

    def until(self, condition, what):
        """Waits for a condition of the status."""
        while True:
            self.status.poll()
            if condition(self.status):
                return
            self.listen()
            if time.monotonic() > self.end:
                raise TimeoutError(f"{what}; LinuxCNC said: {self.messages}")
            time.sleep(0.004)

    def listen(self):
        """Keeps what LinuxCNC says."""
        said = self.errors.poll()
        while said:
            self.messages.append(said[1])
            said = self.errors.poll()

    def start(self):
        """Machine on."""
        self.command.state(linuxcnc.STATE_ESTOP_RESET)
        self.command.wait_complete()
        self.command.state(linuxcnc.STATE_ON)
        self.until(lambda s: s.task_state == linuxcnc.STATE_ON, "the machine does not go on")

    def home(self):
        """All joints homed, then MDI."""
        self.command.mode(linuxcnc.MODE_MANUAL)
        self.command.wait_complete()
        self.command.teleop_enable(0)
        self.command.wait_complete()
        self.command.home(-1)
        self.until(lambda s: all(s.homed[: s.joints]), "the joints are not homed")
        self.command.mode(linuxcnc.MODE_MDI)
        self.command.wait_complete()
        self.until(lambda s: s.task_mode == linuxcnc.MODE_MDI, "no MDI")

    def mdi(self, line):
        """One line of G-code, done and at rest."""
        self.listen()
        before = len(self.messages)
        self.command.mdi(line)
        self.command.wait_complete(30)
        self.until(lambda s: s.inpos and s.interp_state == linuxcnc.INTERP_IDLE and not s.queue, f"{line} does not end")
        self.rest()
        self.listen()
        if self.messages[before:]:
            raise RuntimeError(f"{line}: {self.messages[before:]}")

    def rest(self):
        """Waits until no pin changes."""
        before, same = None, 0
        for _ in range(ATTEMPTS):
            now = self.read()
            same = same + 1 if now == before else 0
            if same >= STILL:
                return
            before = now
            time.sleep(0.004)
        raise TimeoutError(f"the pins do not come to rest: {before}, {now}")

    def read(self):
        """Values of the pins."""
        return [hal.get_value(p) for p in self.pins]

    def step(self, step):
        """One step, and the pins after it."""
        self.setp(step.get("set", {}))
        if step.get("home"):
            self.home()
        if "wait" in step:
            time.sleep(step["wait"])
        if "mdi" in step:
            self.mdi(step["mdi"])
        self.setp(step.get("after", {}))
        self.listen()
        return self.read()

    @staticmethod
    def setp(values):
        """Sets pins and parameters."""
        for name, value in values.items():
            hal.set_p(name, repr(value))


def end_with(owner):
    """Ends the screen, and LinuxCNC with it, where the process that runs the tests has been killed."""
    while True:
        time.sleep(0.5)
        try:
            os.kill(owner, 0)
        except ProcessLookupError:
            os._exit(1)


def main():
    """Runs the task of the folder."""
    with open("task.json", encoding="utf-8") as file:
        task = json.load(file)
    if "owner" in task:
        threading.Thread(target=end_with, args=(task["owner"],), daemon=True).start()
    answer = {"rows": [], "messages": [], "error": None}
    screen = None
    try:
        screen = Screen(task["pins"], task["seconds"])
        screen.start()
        for step in task["steps"]:
            answer["rows"].append(screen.step(step))
    except Exception as error:
        answer["error"] = f"{type(error).__name__}: {error}"
    if screen is not None:
        screen.listen()
        answer["messages"] = screen.messages
    with open("answer.json", "w", encoding="utf-8") as file:
        json.dump(answer, file)


if __name__ == "__main__":
    sys.exit(main())
