"""Checkpoints of online runs: written atomically, and signed with a key of the user."""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import os
import pickle
import secrets
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from motion_gym.contract import SpecError
from motion_gym.data.storage import StorageError, cache_folder, check_writable, write_atomic
from motion_gym.online.run import Run
from motion_gym.stepping.harness import not_copied
from motion_gym.stepping.snapshot import snapshot

MARK = b"motion-gym checkpoint 2\n"
SIGNED = len(MARK) + hashlib.sha256().digest_size


class Checkpoint:
    """The file from which a stopped run continues.

    The file holds pickled objects, which can run any code when they are read. It therefore begins with a signature
    (HMAC-SHA256) made with a random key that only this user can read. A file without a valid signature is refused and
    not unpickled. If the file cannot be written, a warning says so once, and the run goes on.

    Args:
        path: The file.
        identity: Digest of the run from ``identity_of``; the file continues the same run only.
    """

    def __init__(self, path: Path, identity: str):
        self.path, self.identity = path, identity
        self._warned = False
        if path.exists() and not path.is_file():
            raise SpecError(f"The checkpoint {path} is a folder: name a file.")
        with self._warning():
            check_writable(path.parent)

    def load(self) -> Run | None:
        """The saved run; None if there is no file.

        Raises:
            SpecError: The file is not a checkpoint of this user, is damaged, or belongs to another run.
        """
        if not self.path.exists():
            return None
        try:
            content = self.path.read_bytes()
        except OSError as error:
            raise SpecError(f"The checkpoint {self.path} cannot be read ({error}): choose another file.") from None
        if not content.startswith(MARK):
            raise SpecError(f"{self.path} is no checkpoint of an online run: delete it, or choose another file.")
        signature, payload = content[len(MARK) : SIGNED], content[SIGNED:]
        try:
            key = _key(make=False)
        except OSError as error:
            raise SpecError(f"The checkpoint {self.path} cannot be trusted: {error}") from None
        if key is None or not hmac.compare_digest(signature, hmac.digest(key, payload, "sha256")):
            raise SpecError(
                f"{self.path} is damaged, or was not written by this user on this computer, and could run any code if "
                "it were read: delete it, or choose another file."
            )
        identity, run = pickle.loads(payload)
        if identity != self.identity:
            raise SpecError(f"{self.path} is the checkpoint of another run: delete it, or choose another file.")
        return run  # type: ignore[no-any-return]

    def save(self, run: Run) -> None:
        """Write the file; a warning if it cannot be written.

        Raises:
            PredictorError: The predictor cannot be pickled.
        """
        try:
            payload = pickle.dumps((self.identity, run))
        except Exception as error:
            raise not_copied(run.predictor, error) from error
        with self._warning():
            key = _key(make=True)
            assert key is not None
            write_atomic(self.path, MARK + hmac.digest(key, payload, "sha256") + payload)

    def remove(self) -> None:
        """Delete the file, if it exists."""
        with self._warning():
            self.path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _warning(self) -> Any:
        try:
            yield
        except (OSError, StorageError) as error:
            if not self._warned:
                message = f"The run goes on, but its checkpoint is not kept, so it cannot be continued: {error}"
                warnings.warn(message, RuntimeWarning, stacklevel=4)
            self._warned = True


def identity_of(predictor: Any, played: Any, options: Mapping[str, Any], name: str) -> str:
    """Digest of the initial state of the predictor, the stream and the options.

    Args:
        predictor: The predictor, ready for the stream.
        played: The Stream.
        options: Options of ``evaluate_online``.
        name: Name of the predictor.
    """
    sha = hashlib.sha256()
    kind = type(predictor)
    segments = [(label, part.start, part.stop) for label, part in zip(played.labels, played.segments, strict=True)]
    for part in (
        name,
        f"{kind.__module__}.{kind.__qualname__}",
        repr(played),
        played.split,
        segments,
        sorted(options.items()),
    ):
        sha.update(repr(part).encode() + b"\n")
    for path, content in sorted(snapshot(predictor).items(), key=lambda item: item[0]):
        sha.update(f"{path}={content!r}\n".encode())
    for array in (played.clock.tracks.tick, played.clock.tracks.track, played.clock.tracks.xy):
        sha.update(array.tobytes())
    return sha.hexdigest()


def _key(make: bool) -> bytes | None:
    """The user's key; None if there is none and ``make`` is False.

    Raises:
        OSError: The key cannot be read or written.
    """
    path = cache_folder() / "checkpoint.key"
    if not path.exists():
        if not make:
            return None
        path.parent.mkdir(parents=True, exist_ok=True)
        # Written under another name, so that no process ever reads a part of a key.
        temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.tmp")
        try:
            with open(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                file.write(secrets.token_bytes(32))
            with contextlib.suppress(FileExistsError):  # another process was first
                os.link(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    if path.stat().st_mode & 0o077 or path.stat().st_uid != os.getuid():
        raise PermissionError(f"{path} must belong to this user, who alone may read it: delete it.")
    key = path.read_bytes()
    if len(key) != 32:
        raise OSError(f"{path} is damaged: delete it.")
    return key
