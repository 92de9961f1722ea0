"""Opening an exported file in onnxruntime: the session, and the contract that it keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vioapr.errors import ContractError, FormatError, MissingExtraError, UnreadableError
from vioapr.files.paths import AnyPath
from vioapr.schemas.contract import METADATA_KEY, Contract, parse


def open_session(path: AnyPath, threads: int | None = None) -> tuple[Any, Contract]:
    """Load any file that `vioapr export` wrote.

    Args:
        path: The file.
        threads: For every operator; None for all cores.

    Returns:
        onnxruntime's session and the contract.

    Raises:
        FileMissingError: It is not there.
        UnreadableError: It cannot be read.
        FormatError: It is no ONNX file, is truncated, or has no readable contract.
        VersionError: Its contract is of a later version.
        ContractError: It has other inputs or outputs than its contract says.
        MissingExtraError: onnxruntime is not installed.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UnreadableError.of(path, error) from None
    try:
        session = start_session(content, threads)
    except MissingExtraError:
        raise
    except Exception as error:  # onnxruntime has no common class of its errors
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise FormatError(
            path,
            "expected an ONNX file, found one that is truncated, damaged or something else "
            f"({lines[0][:160]})",
        ) from None
    contract = parse(session.get_modelmeta().custom_metadata_map.get(METADATA_KEY), str(path))
    for kind, specs, values in (
        ("inputs", contract.inputs, session.get_inputs()),
        ("outputs", contract.outputs, session.get_outputs()),
    ):
        expected, found = [spec.name for spec in specs], [value.name for value in values]
        if expected != found:
            raise ContractError(
                f"{path}: expected the contract's {kind} {', '.join(expected)}, found "
                f"{', '.join(found)}"
            )
    return session, contract


def require_localizer(contract: Contract, path: Path) -> None:
    """See that a file is a whole localizer.

    Raises:
        ContractError: It is one of a split set.
    """
    if contract.part != "localizer":
        raise ContractError(
            f"{path}: expected a whole localizer, found the part {contract.part!r} of a split one: "
            "export without --split"
        )


def start_session(content: bytes, threads: int | None = None) -> Any:
    """Load a model into onnxruntime, as one of several sessions of a process.

    Args:
        content: Of the ONNX file.
        threads: For every operator; None for all cores.

    Raises:
        MissingExtraError: onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError:
        raise MissingExtraError("running a localizer", "onnxruntime", "runtime") from None
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    options.intra_op_num_threads = threads or 0
    # Between frames, idle workers would take the processor from other sessions, and the battery.
    options.add_session_config_entry("session.force_spinning_stop", "1")
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
