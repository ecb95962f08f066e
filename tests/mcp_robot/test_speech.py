"""Speech is a WAV of known length, with a voice where there is one and silence where not."""

from __future__ import annotations

import shutil

import pytest

from backend.mcp_robot import speech


async def test_without_espeak_it_is_silence_as_long_as_the_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    sound = await speech.synthesize("x" * 45)
    assert not sound.audible
    assert sound.seconds == pytest.approx(3.0)
    assert speech.duration(sound.wav) == pytest.approx(3.0, abs=0.01)


@pytest.mark.skipif(not shutil.which("espeak-ng"), reason="espeak-ng is not installed")
@pytest.mark.parametrize("text", ["The meeting is at noon.", "--help", "-w /dev/null", "<speak>&amp;"])
async def test_with_espeak_every_text_is_text(text: str) -> None:
    sound = await speech.synthesize(text)
    assert sound.audible
    assert sound.seconds == pytest.approx(speech.duration(sound.wav))
    assert 0.1 < sound.seconds < 10
