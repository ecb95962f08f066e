"""Speech as sound: by espeak-ng where it is installed, else silence of fitting length.

The text goes to espeak-ng on its standard input, never on its command line. Nothing here plays a sound.
"""

from __future__ import annotations

import asyncio
import io
import shutil
import wave
from pathlib import Path
from tempfile import TemporaryDirectory

from backend.mcp_robot.robot import Sound

CHARS_PER_SECOND = 15.0
"""About what espeak-ng says at its usual speed."""
SHORTEST = 0.5
"""Seconds that even a short word takes."""
_SILENCE_RATE = 8000
"""Samples a second of a silent WAV."""
_TIME_LIMIT = 20.0
"""Seconds after which espeak-ng has failed."""


async def synthesize(text: str) -> Sound:
    """The sound of a text. Silence, marked as not audible, where there is no voice or it failed."""
    program = shutil.which("espeak-ng")
    sound = await _espeak(program, text) if program else None
    return sound or silence(text)


def silence(text: str) -> Sound:
    """Silence as long as saying the text would take. It is whole samples long, so that its length is exact."""
    samples = round(max(SHORTEST, len(text) / CHARS_PER_SECOND) * _SILENCE_RATE)
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(_SILENCE_RATE)
        file.writeframes(bytes(2 * samples))
    return Sound(buffer.getvalue(), samples / _SILENCE_RATE, audible=False)


async def _espeak(program: str, text: str) -> Sound | None:
    with TemporaryDirectory() as folder:
        # Into a file: on its standard output espeak-ng writes a WAV header without a length.
        target = Path(folder) / "speech.wav"
        process = await asyncio.create_subprocess_exec(
            program, "-v", "en", "-s", "160", "--stdin", "-w", str(target),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            async with asyncio.timeout(_TIME_LIMIT):
                await process.communicate(text.encode())
        except TimeoutError:
            return None
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        try:
            wav = target.read_bytes()
            return Sound(wav, duration(wav), audible=True)
        except (OSError, wave.Error, EOFError):
            return None


def duration(wav: bytes) -> float:
    """Length of a WAV in s. Raises `wave.Error` or `EOFError` for anything else."""
    with wave.open(io.BytesIO(wav)) as file:
        return float(file.getnframes() / file.getframerate())
