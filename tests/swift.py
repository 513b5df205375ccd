"""A real S3 server of the tests' own: OpenStack Swift with its s3api, in a folder of its own."""

import os
import pwd
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

PROGRAMS = ("swift-proxy-server", "swift-account-server", "swift-container-server", "swift-object-server")
ACCESS_KEY, SECRET_KEY = "acromion:tests", "not-a-secret"

_RINGS = """
import sys
from swift.common.ring import RingBuilder
for kind, port in zip(("account", "container", "object"), sys.argv[2:]):
    builder = RingBuilder(4, 1, 0)
    place = dict(region=1, zone=1, ip="127.0.0.1", port=int(port), device="disk", weight=1)
    builder.add_dev(place | dict(replication_ip="127.0.0.1", replication_port=int(port)))
    builder.rebalance()
    builder.get_ring().save(f"{sys.argv[1]}/{kind}.ring.gz")
"""

_STORE = """
[DEFAULT]
bind_ip = 127.0.0.1
bind_port = {port}
devices = {folder}
swift_dir = {folder}
mount_check = false
workers = 0
user = {user}
[pipeline:main]
pipeline = {kind}-server
[app:{kind}-server]
use = egg:swift#{kind}
"""

_FILTERS = ("catch_errors", "gatekeeper", "listing_formats", "bulk", "copy", "slo", "dlo")

_PROXY = """
[DEFAULT]
bind_ip = 127.0.0.1
bind_port = {port}
swift_dir = {folder}
workers = 0
user = {user}
[pipeline:main]
pipeline = catch_errors gatekeeper cache listing_formats bulk s3api tempauth copy slo dlo proxy-server
[app:proxy-server]
use = egg:swift#proxy
conn_timeout = 5
error_suppression_interval = 0.1
account_autocreate = true
allow_account_management = true
[filter:tempauth]
use = egg:swift#tempauth
user_acromion_tests = not-a-secret .admin
[filter:cache]
use = egg:swift#memcache
memcache_servers = 127.0.0.1:{memcache_port}
[filter:s3api]
use = egg:swift#s3api
location = us-east-1
""" + "".join(f"[filter:{name}]\nuse = egg:swift#{name}\n" for name in _FILTERS)


def find_programs() -> bool:
    """Return whether Swift and memcached are installed."""
    return sys.platform == "linux" and all(shutil.which(name) for name in (*PROGRAMS, "memcached"))


class SwiftServer:
    """One proxy, one account, one container and one object server, and the memcached they want."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="acromion-swift-"))
        (self.folder / "disk").mkdir()
        (self.folder / "swift.conf").write_text("[swift-hash]\nswift_hash_path_suffix = acromion\n")
        self._log = (self.folder / "log").open("ab")
        *stores, proxy, memcache = (find_free_port() for _ in range(5))
        rings = ["/usr/bin/python3", "-c", _RINGS, str(self.folder)]  # Debian keeps Swift in its own Python
        subprocess.run([*rings, *map(str, stores)], check=True, timeout=300)
        self._processes = [self._launch("memcached", "-l", "127.0.0.1", "-p", str(memcache), "-u", _user())]
        for kind, port in zip(("account", "container", "object"), stores, strict=True):
            self._start(kind, _STORE, kind=kind, port=port)
        self._start("proxy", _PROXY, port=proxy, memcache_port=memcache)
        self.endpoint = f"http://127.0.0.1:{proxy}"
        self._wait()

    @property
    def environment(self) -> dict[str, str]:
        """What an S3 client has to know."""
        return {
            "AWS_ENDPOINT": self.endpoint,
            "AWS_ALLOW_HTTP": "true",
            "AWS_REGION": "us-east-1",
            "AWS_ACCESS_KEY_ID": ACCESS_KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET_KEY,
        }

    def make_bucket(self) -> str:
        """Make a new bucket, by Swift's own API; gives its address."""
        name = f"acromion-{secrets.token_hex(4)}"
        asked = urllib.request.Request(
            f"{self.endpoint}/auth/v1.0", headers={"X-Auth-User": ACCESS_KEY, "X-Auth-Key": SECRET_KEY}
        )
        with urllib.request.urlopen(asked, timeout=60) as answer:
            address, token = answer.headers["X-Storage-Url"], answer.headers["X-Auth-Token"]
        made = urllib.request.Request(
            f"{address}/{name}", method="PUT", headers={"X-Auth-Token": token}, data=b""
        )
        urllib.request.urlopen(made, timeout=60).close()
        return f"s3://{name}"

    def pause(self) -> None:
        """Answer nobody, as a store that hangs or is away."""
        self._processes[-1].kill()
        self._processes.pop().wait()

    def resume(self) -> None:
        """Answer again."""
        self._processes.append(self._launch("swift-proxy-server", str(self.folder / "proxy.conf")))
        self._wait()

    def remove(self) -> None:
        """Stop, and leave nothing behind."""
        for process in self._processes:
            process.kill()
            process.wait()
        self._log.close()
        shutil.rmtree(self.folder)

    def _start(self, program: str, text: str, **values: object) -> None:
        settings = self.folder / f"{program}.conf"
        settings.write_text(text.format(folder=self.folder, user=_user(), **values))
        self._processes.append(self._launch(f"swift-{program}-server", str(settings)))

    def _launch(self, *command: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, stdout=self._log, stderr=self._log, cwd=self.folder)

    def _wait(self) -> None:
        """Wait until the proxy and those behind it answer."""
        for _ in range(600):
            try:
                self.make_bucket()
            except OSError:  # nobody listens, or the proxy finds nobody behind it
                time.sleep(0.1)
            else:
                return
        raise TimeoutError((self.folder / "log").read_text())


def find_free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _user() -> str:
    return pwd.getpwuid(os.geteuid()).pw_name
