#!/bin/sh
# Set up a clinic server on Debian, from this repository, as root; a repeated call changes only what differs.
#   docker/setup-clinic.sh NAME CERT.pem KEY.pem LOGIN        NAME: the host name; LOGIN: the first account
set -eu
[ $# -eq 4 ] || { sed -n '2,3s/^# //p' "$0" >&2; exit 2; }
name=$1 cert=$2 key=$3 login=$4
case $name in *[!A-Za-z0-9.-]* | '' | -*) echo "not a host name: $name" >&2; exit 2 ;; esac
openssl x509 -noout -checkhost "$name" -in "$cert" 2>/dev/null | grep -q "does match" ||
  { echo "the certificate $cert is not for $name" >&2; exit 2; }
src=$(cd "$(dirname "$0")/.." && pwd)

export DEBIAN_FRONTEND=noninteractive
apt-get update -q
apt-get install -qy python3-venv nginx openssl curl
id acromion >/dev/null 2>&1 ||
  useradd --system --user-group --home-dir /var/lib/acromion --shell /usr/sbin/nologin acromion
usermod -aG acromion www-data
install -d -o acromion -g acromion -m 700 /var/lib/acromion /var/cache/acromion /var/backups/acromion
install -d -m 750 -g acromion /etc/acromion /etc/acromion/tls
install -m 644 "$cert" /etc/acromion/tls/cert.pem
install -m 600 "$key" /etc/acromion/tls/key.pem
if [ ! -e /etc/acromion/acromion.env ]; then # kept if it exists: it may hold your settings
  install -m 640 -g acromion "$src/docker/clinic.env.example" /etc/acromion/acromion.env
  sed -i "s/acromion\.clinic\.example/$name/" /etc/acromion/acromion.env
fi
chgrp acromion /etc/acromion/acromion.env && chmod 640 /etc/acromion/acromion.env
sed "s/acromion\.clinic\.example/$name/" "$src/docker/nginx.conf" >/etc/nginx/conf.d/acromion.conf
rm -f /etc/nginx/sites-enabled/default
install -m 755 "$src/docker/acromion-admin" /usr/local/sbin/
[ -x /opt/acromion/bin/acromion ] || acromion-admin install "$src"
if ! acromion-admin account list 2>/dev/null | grep -q .; then
  acromion-admin account add "$login" --role manager
fi
nginx -t
systemctl enable --now acromion acromion-backup.timer
systemctl restart nginx
systemctl start acromion-backup || echo "no backup: see journalctl -u acromion-backup" >&2
acromion-admin doctor || echo "see the lines above; the server runs" >&2
