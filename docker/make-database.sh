#!/bin/sh
# Run once by the image of PostgreSQL, as its owner: a role without privileges that owns the one database.
set -eu
psql --set ON_ERROR_STOP=1 --username "${POSTGRES_USER:-postgres}" --set "password=$DATABASE_PASSWORD" <<'SQL'
CREATE ROLE acromion LOGIN PASSWORD :'password';
CREATE DATABASE acromion OWNER acromion;
REVOKE ALL ON DATABASE acromion FROM PUBLIC;
SQL
