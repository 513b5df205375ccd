#!/bin/sh
# Create the database and the role that owns it, without other privileges. The PostgreSQL image runs it once.
set -eu
psql --set ON_ERROR_STOP=1 --username "${POSTGRES_USER:-postgres}" --set "password=$DATABASE_PASSWORD" <<'SQL'
CREATE ROLE acromion LOGIN PASSWORD :'password';
CREATE DATABASE acromion OWNER acromion;
REVOKE ALL ON DATABASE acromion FROM PUBLIC;
SQL
