"""Rigs for the page: daemons of their own, with the shipped rig file or one of an arm that can be unplugged and a camera that plays a folder."""
import json, re, signal, subprocess, urllib.request
from pathlib import Path

SHIPPED = Path(__file__).resolve().parents[2] / "rig-config" / "rigs" / "simulated.toml"


def shipped():
    return SHIPPED.read_text()


def calibrated():
    """The shipped rig with a board, a card and balls to be calibrated with."""
    return (SHIPPED.parent / "simulated-calibration.toml").read_text()


def slower(speed):
    """The shipped rig, its time running so many times faster than real."""
    return re.sub(r"(?m)^speed = .*$", f"speed = {speed}.0", shipped())


def replayed(port, frames):
    """A rig of the arm behind `port` and a camera that plays the folder `frames`: no driver is simulated, so time is real."""
    text = shipped()[:shipped().index("[simulation]")]
    text = re.sub(r'(?ms)(^\[arm\].*?)driver = "simulated"', rf'\1driver = "rigproto"\nport = "{port}"', text, count=1)
    text = re.sub(r'(?ms)(^\[camera\].*?)driver = "simulated"', rf'\1driver = "replay"\ndirectory = "{frames}"', text, count=1)
    return text.replace("soak_s = 5.0", "soak_s = 0.5").replace("settle_s = 0.5", "settle_s = 1.0")


class Daemon:
    """`rigd serve` in a folder of its own; killed and started again it listens where it did."""

    def __init__(self, rigd, folder, config):
        folder.mkdir()
        self.rigd, self.folder, self.listen = rigd, folder, "127.0.0.1:0"
        (folder / "rig.toml").write_text(config)
        self.start()

    def start(self):
        command = [self.rigd, "serve", "--config", self.folder / "rig.toml", "--data", self.folder / "data", "--listen", self.listen]
        with open(self.folder / "log", "a") as log:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        self.url = re.match(r"listening on (\S+)", self.process.stdout.readline())[1]
        self.listen = self.url.removeprefix("http://")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def call(self, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url + path, data, {"content-type": "application/json"})
        with urllib.request.urlopen(request, timeout=20) as answer:
            return json.load(answer)

    def start_session(self, name):
        self.call("/v1/sessions", {"name": name})

    def session(self):
        """The newest."""
        return self.call("/v1/sessions?max_page_size=1")["sessions"][0]

    def events(self):
        """Every record of the newest session so far, from its journal."""
        journal = self.folder / "data" / "sessions" / self.session()["id"] / "journal.jsonl"
        return [json.loads(line) for line in journal.read_text().splitlines(keepends=True) if line.endswith("\n")]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(60)


class Arm:
    """`rigd simulate arm`: its port goes when it is unplugged, and is back when it is plugged in."""

    def __init__(self, rigd, folder):
        self.rigd, self.link, self.process = rigd, folder / "arm", None
        self.plug()

    def plug(self):
        command = [self.rigd, "simulate", "arm", "--config", SHIPPED, "--link", self.link]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.process.stdout.readline()

    def unplug(self):
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(10)
