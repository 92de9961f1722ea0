"""OpenGL without a screen: moderngl on EGL, by the processor where there is no GPU."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vioapr.errors import MissingExtraError, VioAprError

if TYPE_CHECKING:
    import moderngl

DEBIAN_PACKAGES = ("libegl1", "libgl1", "libgl1-mesa-dri")


class RenderingError(VioAprError):
    """Nothing can be rendered on this machine."""


def create_context() -> moderngl.Context:
    """Open a context of its own.

    Raises:
        MissingExtraError: moderngl is not installed.
        RenderingError: There is no EGL, or no driver for it.
    """
    try:
        import moderngl
    except ImportError:
        raise MissingExtraError("rendering", "moderngl", "render") from None
    try:
        # moderngl types its keywords by those of another function.
        options: dict[str, Any] = {"standalone": True, "backend": "egl", "require": 330}
        return moderngl.create_context(**options)
    except Exception as error:  # glcontext raises plain Exception
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RenderingError(
            f"cannot render: OpenGL on EGL is not available ({reason}); on Debian or "
            f"Ubuntu: apt-get install {' '.join(DEBIAN_PACKAGES)}"
        ) from None


def describe(context: Any) -> str:
    """The name of the renderer, e.g. "llvmpipe (LLVM 15.0.6, 256 bits)"."""
    return str(context.info["GL_RENDERER"])
