"""Set up, upgrade and roll back a clinic server in a namespace, with stubs of systemd, apt and nginx."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from acromion.app.library.rows import Job
from acromion.app.settings import Settings
from tests import ROOT
from tests.crash.rounds import can_cut_power

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not can_cut_power() or not shutil.which("unshare"), reason="no root"
)

NAMESPACE = """set -eu
for place in etc opt var usr/local; do
  mkdir -p {base}/$place/up {base}/$place/work
  mount -t overlay overlay -o lowerdir=/$place,upperdir={base}/$place/up,workdir={base}/$place/work /$place
done
rm -rf /opt/acromion /etc/acromion
mkdir -p /etc/nginx/conf.d /etc/nginx/sites-enabled /etc/systemd/system
getent passwd www-data >/dev/null || useradd --system www-data
export PATH={stubs}:/usr/local/sbin:$PATH READY_TRIES=1
"""
PYTHON = """#!/bin/sh
# python3 -m venv FOLDER
mkdir -p "$3/bin"
printf '#!/bin/sh\\nexit 0\\n' >"$3/bin/pip"; cp "$3/bin/pip" "$3/bin/python"
printf '#!/bin/sh\\necho acromion "$@" >>{log}\\n' >"$3/bin/acromion"
printf '[ "$1 $2" != "account list" ] || cat {base}/people\\n' >>"$3/bin/acromion"
printf '[ "$1 $2" != "account add" ] || echo "$3" >>{base}/people\\n' >>"$3/bin/acromion"
printf '[ "$1" != backup ] || touch "$2"\\n' >>"$3/bin/acromion"
chmod 755 "$3/bin/"*
"""
STUBS = {
    "systemctl": '#!/bin/sh\necho systemctl "$@" >>{log}\n',
    "nginx": '#!/bin/sh\necho nginx "$@" >>{log}\n',
    "apt-get": '#!/bin/sh\necho apt-get "$@" >>{log}\n',
    "curl": "#!/bin/sh\ncase $(readlink /opt/acromion/current) in $(cat {base}/broken)) exit 1 ;; esac\n",
    "systemd-run": '#!/bin/sh\nwhile case $1 in --*) true ;; *) false ;; esac; do shift; done\nexec "$@"\n',
    "python3": PYTHON,
}


def run(base: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a namespace whose /etc, /opt, /var and /usr/local are layers of their own."""
    stubs, log = base / "stubs", base / "log"
    stubs.mkdir(exist_ok=True)
    for name, text in STUBS.items():
        (stubs / name).write_text(text.replace("{log}", str(log)).replace("{base}", str(base)))
        (stubs / name).chmod(0o755)
    for name in ("people", "broken", "log"):
        (base / name).touch()
    start = NAMESPACE.format(base=base, stubs=stubs)
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", start + script], capture_output=True, text=True, check=False
    )
    if "mount:" in done.stderr:
        pytest.skip("no overlay file systems here")
    return done


@pytest.fixture
def setup(tmp_path: Path) -> str:
    """Return the command, with a certificate for its name."""
    key, cert = tmp_path / "key.pem", tmp_path / "cert.pem"
    wanted = ["-subj", "/CN=a.example", "-addext", "subjectAltName=DNS:a.example", "-days", "2"]
    made = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-keyout",
        str(key),
        "-out",
        str(cert),
    ]
    subprocess.run([*made, *wanted], check=True, capture_output=True)
    return f"{ROOT}/docker/setup-clinic.sh a.example {cert} {key} maria\n"


def test_a_repeated_setup_makes_one_server_and_one_account(tmp_path: Path, setup: str) -> None:
    show = "stat -c '%a %U %n' /var/lib/acromion /etc/acromion/tls/key.pem; cat /etc/acromion/acromion.env\n"
    show += "readlink /opt/acromion/bin; grep -c a.example /etc/nginx/conf.d/acromion.conf\n"
    show += "ls /etc/systemd/system"
    done = run(tmp_path, f"{setup}echo ACROMION_PAPER=a4 >>/etc/acromion/acromion.env\n{setup}{show}")
    log = (tmp_path / "log").read_text()

    assert done.returncode == 0, done.stderr
    for told in ("700 acromion /var/lib/acromion", "600 root /etc/acromion/tls/key.pem", "current/bin"):
        assert told in done.stdout
    assert "ACROMION_HOSTS=a.example" in done.stdout
    assert "ACROMION_PAPER=a4" in done.stdout  # a setting of the administrator is kept
    assert {"acromion.service", "acromion-backup.service", "acromion-backup.timer"} <= set(
        done.stdout.split()
    )
    assert log.count("acromion account add maria --role manager") == 1
    assert log.count("systemctl enable --now acromion acromion-backup.timer") == 2
    assert log.index("nginx -t") < log.index("systemctl restart nginx")


def test_a_foreign_certificate_is_refused_before_anything_changes(tmp_path: Path, setup: str) -> None:
    done = run(tmp_path, setup.replace("a.example", "b.example"))

    assert done.returncode == 2
    assert "not for b.example" in done.stderr
    assert (tmp_path / "log").read_text() == ""


@pytest.mark.parametrize("is_broken", [False, True], ids=["ready", "not ready"])
def test_an_upgrade_backs_up_switches_and_goes_back_if_it_is_not_ready(
    tmp_path: Path, setup: str, is_broken: bool
) -> None:
    first = "first=$(readlink /opt/acromion/current); sleep 1\n"
    broken = f"( echo '*' >{tmp_path}/broken )\n" if is_broken else ""
    after = "code=0; acromion-admin upgrade " + str(ROOT) + " || code=$?\necho code $code\n"
    after += '[ "$(readlink /opt/acromion/current)" != "$first" ] || echo first runs\n'
    back = 'acromion-admin rollback; [ "$(readlink /opt/acromion/current)" != "$first" ] || echo back\n'
    done = run(tmp_path, setup + first + broken + after + ("" if is_broken else back))
    log = (tmp_path / "log").read_text()

    assert f"code {int(is_broken)}" in done.stdout, done.stderr
    assert ("first runs" in done.stdout) == is_broken
    assert ("back" in done.stdout.splitlines()) != is_broken
    assert log.index("acromion backup /var/backups/acromion/before-upgrade-") < log.index(
        "systemctl stop acromion"
    )
    assert log.count("systemctl start acromion\n") == 2


REAL = """first=$(readlink /opt/acromion/current)
program='ACROMION_DATA_DIR=/var/lib/acromion exec {python} -P -m acromion "$@"'
printf '#!/bin/sh\\n%s\\n' "$program" >"$first/bin/acromion"
ln -sf {python} "$first/bin/python"
cp -r {data}/. /var/lib/acromion/
export PYTHONPATH={root}
sleep 1
"""
LATER = """cd /var/lib/acromion
{python} <<'END'
import sqlite3
with sqlite3.connect("acromion.sqlite3") as rows:
    rows.execute("UPDATE alembic_version SET version_num = 'later'")
END
echo later >recordings/rec_later
cd /
"""


def test_a_rollback_over_changed_tables_asks_and_restores_the_backup_of_the_upgrade(
    tmp_path: Path, setup: str, finished: Job, settings: Settings
) -> None:
    facts = {"python": sys.executable, "data": settings.data_dir, "root": ROOT}
    script = setup + REAL.format(**facts) + f"acromion-admin upgrade {ROOT}\n" + LATER.format(**facts)
    script += "acromion-admin rollback </dev/null || echo refused $?\n"
    script += "echo yes | acromion-admin rollback\nls /var/lib/acromion.*/recordings\n"
    script += '[ "$(readlink /opt/acromion/current)" != "$first" ] || acromion-admin verify\n'
    done = run(tmp_path, script)
    told, _, after = done.stdout.partition("refused 2")

    assert done.returncode == 0, done.stderr
    assert "uploaded since, which it does not contain: 1\n  rec_later" in told
    assert after.splitlines()[-4:-1] == [finished.recording_id, f"{finished.recording_id}.json", "rec_later"]
    assert "all match their database rows" in after


def test_a_restore_keeps_the_present_data_beside_those_of_the_backup(
    tmp_path: Path, setup: str, finished: Job, settings: Settings
) -> None:
    facts = {"python": sys.executable, "data": settings.data_dir, "root": ROOT}
    script = setup + REAL.format(**facts) + f"acromion-admin backup {tmp_path}/b.zip\n"
    script += "echo later >/var/lib/acromion/recordings/rec_later\n"
    script += f"echo yes | acromion-admin restore {tmp_path}/b.zip\n"
    script += "ls /var/backups/acromion /var/lib/acromion.*/recordings /var/lib/acromion/recordings\n"
    done = run(tmp_path, script)
    names = [finished.recording_id, f"{finished.recording_id}.json"]

    assert done.returncode == 0, done.stderr
    assert [line for line in done.stdout.splitlines() if line.startswith("rec_")] == [
        *names,
        "rec_later",
        *names,
    ]
    assert "restore." not in done.stdout.partition("/var/backups/acromion:")[2]
