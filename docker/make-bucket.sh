#!/bin/sh
# Create the bucket and a user who can use this bucket only. MinIO's client image runs it with the root key.
set -eu
until mc alias set store http://objects:9000 "$MINIO_ROOT_USER" "$MINIO_ROOT_PASSWORD"; do sleep 1; done
mc mb --ignore-existing store/acromion
mc admin policy create store acromion /bucket-policy.json
mc admin user add store "$BUCKET_USER" "$BUCKET_PASSWORD"
mc admin policy attach store acromion --user "$BUCKET_USER" || mc admin user info store "$BUCKET_USER" | grep -q acromion
