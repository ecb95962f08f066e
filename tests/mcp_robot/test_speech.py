"""Speech is a WAV of known length: with a voice where espeak-ng is installed, and silence where it is not."""

from __future__ import annotations

import shutil

import pytest

from backend.mcp_robot import speech

VOICES = ["silence", "espeak-ng"]
TEXTS = ["The meeting is at noon.", "--help", "-w /dev/null", "<speak>&amp;"]
"""Texts that a command line or a markup parser would take for something else."""


@pytest.fixture(params=VOICES)
def audible(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether this test has a voice; without one espeak-ng is out of reach."""
    if request.param == "silence":
        monkeypatch.setenv("PATH", "")
    elif not shutil.which("espeak-ng"):
        pytest.skip("espeak-ng is not installed, so that the same text is tested on silence alone")
    return bool(request.param == "espeak-ng")


@pytest.mark.parametrize("text", TEXTS)
async def test_every_text_is_a_sound_that_lasts_as_long_as_it_says(text: str, audible: bool) -> None:
    sound = await speech.synthesize(text)
    assert sound.audible is audible
    assert sound.seconds == pytest.approx(speech.duration(sound.wav), abs=1e-6)
    assert 0.1 < sound.seconds < 10


@pytest.mark.parametrize("length", [1, 23, 45, 46])
async def test_silence_lasts_as_long_as_the_text_would(length: int) -> None:
    sound = speech.silence("x" * length)
    assert sound.seconds == speech.duration(sound.wav)
    assert sound.seconds == pytest.approx(max(0.5, length / 15), abs=1e-3)
