"""The secret of a server: what it encrypted is read with it alone, and a lost one costs nothing else."""

from pathlib import Path

import pytest

from app.errors import SecretUnreadable
from app.storage.server_secret import LENGTH_BYTES, ServerSecret


def test_what_was_encrypted_is_read_again_for_its_own_purpose_alone(tmp_path: Path) -> None:
    token = ServerSecret(tmp_path).encrypt("whsec_é", "webhook")
    again = ServerSecret(tmp_path)

    assert "whsec" not in token
    assert again.decrypt(token, "webhook") == "whsec_é"
    with pytest.raises(SecretUnreadable):
        again.decrypt(token, "second factor of clara")
    assert again.derive("logins") == again.derive("logins") != again.derive("others")


def test_only_its_user_reads_the_file(tmp_path: Path) -> None:
    ServerSecret(tmp_path / "data").encrypt("a", "b")

    file = tmp_path / "data" / "server.key"
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    assert file.stat().st_size == LENGTH_BYTES
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("content", [None, b"", b"garbage", b"x" * 45])
def test_a_lost_or_damaged_file_is_named_and_made_anew_for_what_comes(
    tmp_path: Path, content: bytes | None
) -> None:
    secret = ServerSecret(tmp_path)
    token = secret.encrypt("a", "webhook")
    secret.file.unlink() if content is None else secret.file.write_bytes(content)

    with pytest.raises(SecretUnreadable) as refused:
        secret.decrypt(token, "webhook")
    assert refused.value.facts == {"file": str(tmp_path / "server.key")}

    assert secret.decrypt(secret.encrypt("b", "webhook"), "webhook") == "b"
