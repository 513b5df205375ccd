"""Read MVNX, the XML export of Xsens MVN from MVN 2018 on: the orientation of the upper arm, frame by frame.

The file is read as a stream; a document type and entities are rejected. The arm axis comes from the file:
from the elbow point to the shoulder point in the frame of the upper-arm segment (``points/pos_b``). Without
these points it is the segment's y axis, which MVN aligns with the arm (towards the left of the body, so it
points to the shoulder on the right side). If an export omits the orientations, the joint positions give the
same angle: the direction from the elbow (origin of the forearm) to the shoulder (origin of the upper arm).
MVN's joint angles cannot be used: its shoulder angles are relative to the trunk, not to gravity.

Source: Xsens MVN User Manual, chapter on the MVNX format (version 4).
"""

from array import array
from dataclasses import replace
from datetime import UTC, datetime
from math import isfinite, nan
from typing import Any
from xml.sax import SAXException
from xml.sax.handler import ContentHandler, feature_external_ges, feature_external_pes

import numpy as np
from defusedxml.common import DefusedXmlException

from acromion.fusion.angle_files.angle_series import (
    AngleFile,
    AngleFileOptions,
    Up,
    build_orientation_file,
    compute_up_from_quaternion,
    compute_up_from_row,
    measure_from_up,
)
from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import MissingSegment, RefusedXml, TooShort, UnknownRate
from acromion.fusion.readers.samples import check_rows
from acromion.fusion.readers.source import CHUNK_BYTES, Source
from acromion.fusion.recording import Float64Array, QualityFlag

MARK = b"<mvnx"
DEFAULT_SIDE = "right"
LATEST_MS = 4e12
MOST_LABELS = 4096
MOST_DEPTH = 64
MOST_TEXT_SIGNS = 1 << 20
MOST_SILENT_BYTES = 16 << 20
"""MVN files have a few hundred names and points, nine levels of elements, some kilobytes of numbers in one
element, and no name or comment of megabytes.
"""
TOWARDS_SHOULDER = {"right": (0.0, 1.0, 0.0), "left": (0.0, -1.0, 0.0)}
"""MVN aligns the segment's y axis with the arm, towards the left of the body, in the T-pose."""


def recognise(source: Source) -> bool:
    """Return whether the root of the XML is ``mvnx``, or a document type may hide it."""
    head = source.head.lstrip(b"\xef\xbb\xbf \t\r\n")
    return head.startswith(b"<") and (MARK in source.head or source.extension == ".mvnx")


def read(source: Source, options: AngleFileOptions) -> AngleFile:
    """Read the upper arm of one side.

    Raises
    ------
    RefusedXml
        A document type, entities, cut off, not MVNX, or an element that no export contains.
    acromion.fusion.errors.TooLong
    MissingSegment
        No upper arm of that side, or neither its orientation nor its position.
    UnknownRate
        Neither a frame rate nor times.
    TooShort
        No movement frame.
    """
    side = options.side or DEFAULT_SIDE
    frames = _Frames(side)
    _parse(source, frames)
    if not frames.times:
        raise TooShort(s=0.0)
    up, axis = _find_up(frames, side)
    since_ms = frames.times[2]  # since 1970, UTC, at the first frame
    start = datetime.fromtimestamp(since_ms / 1000.0, UTC) if 0 < since_ms < LATEST_MS else None
    time_s, understood = _find_times(frames), _describe(frames, side, axis)
    file = build_orientation_file("mvn", source, time_s, up, understood, start)
    assert file.up is not None
    return replace(
        file,
        elevation_deg=measure_from_up(file.up, axis),
        axis=axis,
        flags=() if options.side else (QualityFlag(Caveat.SIDE_ASSUMED),),
    )


class _Frames(ContentHandler):
    """XML handler that stores the numbers of one arm only, packed.

    ``times`` has three numbers per frame (index, milliseconds since the start, milliseconds since 1970),
    ``orientation`` four, ``towards`` three (elbow to shoulder, m; only while there is no orientation).
    """

    def __init__(self, side: str) -> None:
        super().__init__()
        self.arm, self.forearm = f"{side.capitalize()}UpperArm", f"{side.capitalize()}ForeArm"
        self.header: dict[str, str] = {}
        self.labels: list[str] = []
        self.points: dict[str, list[float]] = {}
        self.times, self.orientation, self.towards = array("d"), array("d"), array("d")
        self.pose_orientation: list[float] | None = None
        self.events = 0
        self._path: list[str] = []
        self._text: list[str] = []
        self._text_signs = 0
        self._frame: dict[str, str] = {}
        self._found: dict[str, list[float]] = {}
        self._point = ""

    def startElement(self, name: str, attrs: Any) -> None:  # noqa: N802  the name that SAX calls
        """Track the current element."""
        if not self._path and name != "mvnx":
            raise RefusedXml(reason="not MVNX")
        self._path.append(name)
        self.events += 1
        self._text.clear()
        self._text_signs = 0
        self._refuse_large(len(self._path) > MOST_DEPTH or len(self.labels) + len(self.points) > MOST_LABELS)
        if name == "frame":
            self._frame, self._found = dict(attrs.items()), {}
        elif name in {"mvnx", "mvn", "subject"}:
            self.header |= {f"{name}_{key}": value for key, value in attrs.items()}
        elif name == "segment":
            self.labels.append(attrs.get("label", ""))
        elif name == "point":
            self._point = attrs.get("label", "")

    def characters(self, content: str) -> None:
        """Store the text of the few elements that are read."""
        self.events += 1
        if self._path[-1] in {"orientation", "position", "pos_b"}:
            self._text.append(content)
            self._text_signs += len(content)
            self._refuse_large(self._text_signs > MOST_TEXT_SIGNS)

    def _refuse_large(self, is_large: bool) -> None:  # noqa: FBT001
        if is_large:
            raise RefusedXml(reason="broken")

    def endElement(self, name: str) -> None:  # noqa: N802
        """Parse the numbers of a complete element."""
        self.events += 1
        self._path.pop()
        if name == "orientation":
            self._found[name] = self._cut(self.arm, 4)
        elif name == "position" and not self.orientation:
            shoulder, elbow = self._cut(self.arm, 3), self._cut(self.forearm, 3)
            self._found[name] = [a - b for a, b in zip(shoulder, elbow, strict=False)]
        elif name == "pos_b" and self.labels[-1:] == [self.arm]:
            self.points[self._point] = _to_numbers(self._split())
        elif name == "frame":
            self._end_frame()

    def _end_frame(self) -> None:
        kind = self._frame.get("type", "normal")
        if kind == "tpose":
            self.pose_orientation = self._found.get("orientation") or None
        if kind != "normal":
            return
        for key in ("index", "time", "ms"):
            self.times.extend(_to_numbers([self._frame.get(key) or "nan"]))
        if self._found.get("orientation") or self.orientation:
            missing = len(self.times) // 3 - 1 - len(self.orientation) // 4
            self.orientation.extend([nan] * (4 * missing) + (self._found.get("orientation") or [nan] * 4))
        else:
            self.towards.extend(self._found.get("position") or [nan] * 3)

    def _split(self) -> list[str]:
        return "".join(self._text).split()

    def _cut(self, label: str, count: int) -> list[float]:
        """Return the numbers of one segment; none if the frame has fewer values than segments."""
        if label not in self.labels:
            return []
        first = self.labels.index(label) * count
        words = self._split()[first : first + count]
        return _to_numbers(words) if len(words) == count else []


def _to_numbers(words: list[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        return [nan] * len(words)


def _parse(source: Source, frames: _Frames) -> None:
    """Feed the parser in chunks; it expands no entity and follows no reference."""
    from defusedxml.expatreader import create_parser  # noqa: PLC0415  slow to load, and only this needs it

    parser = create_parser(forbid_dtd=True, forbid_entities=True, forbid_external=True)
    parser.setFeature(feature_external_ges, False)  # noqa: FBT003  the standard library's own signature
    parser.setFeature(feature_external_pes, False)  # noqa: FBT003
    parser.setContentHandler(frames)
    try:
        silent_bytes = 0
        source.file.seek(0)
        while piece := source.file.read(CHUNK_BYTES):
            events = frames.events
            parser.feed(piece)
            silent_bytes = silent_bytes + len(piece) if frames.events == events else 0
            if silent_bytes > MOST_SILENT_BYTES:
                raise RefusedXml(reason="broken")
            check_rows(len(frames.times) // 3, source.read_bytes, source.size_bytes)
        parser.close()
    except (DefusedXmlException, SAXException) as error:
        reason = "forbidden" if isinstance(error, DefusedXmlException) else "broken"
        raise RefusedXml(reason=reason) from error


def _find_up(frames: _Frames, side: str) -> tuple[Up, Float64Array]:
    """Return the zenith in the segment's frame (n, 3) and the axis towards the shoulder."""
    orientation = np.asarray(frames.orientation).reshape(-1, 4)
    if np.isfinite(orientation).any():
        return compute_up_from_quaternion(orientation), _find_axis(frames, side)
    towards = np.asarray(frames.towards).reshape(-1, 3)
    if not np.isfinite(towards).any():
        raise MissingSegment(segment=frames.arm)
    # In a frame whose z axis is the arm, the angle between the zenith and z is the elevation, in the x-z
    # plane.
    across = np.hypot(towards[:, 0], towards[:, 1])
    up = compute_up_from_row(np.stack([across, np.zeros(len(across)), towards[:, 2]], axis=1) * 10.0)
    return up, np.array([0.0, 0.0, 1.0])


def _find_axis(frames: _Frames, side: str) -> Float64Array:
    elbow = frames.points.get(f"j{side.capitalize()}Elbow")
    shoulder = frames.points.get(f"j{side.capitalize()}Shoulder", [0.0, 0.0, 0.0])
    axis = np.array(shoulder) - np.array(elbow) if elbow else np.array(TOWARDS_SHOULDER[side])
    length = float(np.linalg.norm(axis)) if axis.shape == (3,) else np.nan
    return axis / length if isfinite(length) and length > 0.01 else np.array(TOWARDS_SHOULDER[side])


def _find_times(frames: _Frames) -> Float64Array:
    """Return seconds from the first frame: frame numbers over the rate, because they are not rounded."""
    index, since_ms, _ = np.asarray(frames.times).reshape(-1, 3).T
    rate_hz = float(frames.header.get("subject_frameRate") or "nan")
    if rate_hz > 0 and np.isfinite(index).all() and (np.diff(index) > 0).all():
        return np.asarray((index - index[0]) / rate_hz)
    if np.isfinite(since_ms).all() and (np.diff(since_ms) > 0).all():
        return np.asarray((since_ms - since_ms[0]) / 1000.0)
    if rate_hz > 0:
        return np.asarray(np.arange(len(index)) / rate_hz)
    raise UnknownRate


def _describe(frames: _Frames, side: str, axis: Float64Array) -> dict[str, str]:
    understood = {
        "layout": "MVNX",
        "version": frames.header.get("mvn_version", ""),
        "side": side,
        "segment": frames.arm,
        "axis": " ".join(f"{value:.3f}" for value in axis),
        "source": "orientation" if frames.orientation else "position",
        "rate_hz": frames.header.get("subject_frameRate", ""),
    }
    if frames.pose_orientation is not None:
        pose_up = compute_up_from_quaternion(np.array([frames.pose_orientation]))
        understood["t_pose_elevation_deg"] = f"{float(measure_from_up(pose_up, axis)[0]):.1f}"
    return understood
