"""The firmwares' build for boards: what it says when something is missing, and with the vendor's HAL, the programs."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.shared import ROOT

pytestmark = pytest.mark.live

HAL = Path(os.environ.get("STM32_HAL_PATH", "/nonexistent"))
FAMILIES = {"stm32f407": "STM32F4xx", "stm32g473": "STM32G4xx"}
FIRMWARES = ["echo", "servo", "axis", "rover", "balance", "gimbal"]
# Interrupts without which a program is silent, by board; the gimbal's senders have four more.
HANDLERS = {
    "stm32f407": ["SysTick", "USART3", "DMA1_Stream1", "DMA1_Stream3"],
    "stm32g473": ["SysTick", "USART3", "DMA1_Channel1", "DMA1_Channel7"],
}
SENDERS = {
    "stm32f407": ["TIM6_DAC", "TIM7", "TIM8_UP_TIM13", "TIM8_TRG_COM_TIM14"],
    "stm32g473": ["TIM6_DAC", "TIM7_DAC", "TIM1_UP_TIM16", "TIM1_TRG_COM_TIM17"],
}
STACK = {"stm32f407": 0x2002_0000, "stm32g473": 0x2001_8000}


def run(*command: str | Path) -> str:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


def refusal(build: Path, *options: str) -> str:
    """Return CMake's message when it stops, in one line."""
    command = ["cmake", "-S", str(ROOT / "firmware"), "-B", str(build), *options]
    environment = {name: value for name, value in os.environ.items() if name != "STM32_HAL_PATH"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode != 0
    return " ".join(done.stderr.split())


def test_a_missing_path_gets_a_sentence(tmp_path: Path) -> None:
    said = refusal(tmp_path, "-DBOARD=stm32g473")
    assert "the vendor's HAL is missing: add -DSTM32_HAL_PATH=<folder>, a copy of STM32CubeG4" in said


def test_a_path_without_a_hal_gets_a_sentence(tmp_path: Path) -> None:
    said = refusal(tmp_path / "build", f"-DSTM32_HAL_PATH={tmp_path}")
    assert f"STM32_HAL_PATH is {tmp_path}, and 0 folders Drivers/STM32F4xx_HAL_Driver lie there" in said


def test_a_path_to_half_a_package_names_what_it_lacks(tmp_path: Path) -> None:
    include = tmp_path / "STM32CubeF4" / "Drivers" / "STM32F4xx_HAL_Driver" / "Inc"
    include.mkdir(parents=True)
    said = refusal(tmp_path / "build", f"-DSTM32_HAL_PATH={tmp_path}")
    assert f"STM32_HAL_PATH lacks {include / 'stm32f4xx_hal.h'}; it must be a whole STM32CubeF4" in said


def test_an_unknown_board_gets_a_sentence(tmp_path: Path) -> None:
    assert "BOARD is 'stm32f103'; it can be stm32f407 or stm32g473" in refusal(tmp_path, "-DBOARD=stm32f103")


@pytest.mark.skipif(not HAL.is_dir(), reason="STM32_HAL_PATH names no folder with the vendor's HAL")
@pytest.mark.parametrize("board", FAMILIES)
def test_all_firmwares_are_built_for_the_board_with_the_vendors_hal(board: str, tmp_path: Path) -> None:
    drivers = f"Drivers/{FAMILIES[board]}_HAL_Driver"
    if not [*HAL.glob(drivers), *HAL.glob(f"*/{drivers}")]:
        pytest.skip(f"STM32_HAL_PATH has no HAL of the {FAMILIES[board]}")
    command = Path(sys.executable).with_name("wirebond")
    options = [f"-DBOARD={board}", f"-DSTM32_HAL_PATH={HAL}", f"-DWIREBOND_COMMAND={command}"]
    run("cmake", "-S", ROOT / "firmware", "-B", tmp_path, "-G", "Ninja", *options)
    assert run("cmake", "--build", tmp_path).count("text\t") == len(FIRMWARES)  # each one's size
    for name in FIRMWARES:
        symbols = run("arm-none-eabi-nm", tmp_path / f"{name}.elf")
        address = {symbol: int(value, 16) for value, symbol in re.findall(r"^(\w+) \w (\w+)$", symbols, re.MULTILINE)}
        assert {"main", "Reset_Handler"} <= address.keys()
        vectors = (tmp_path / f"{name}.bin").read_bytes()[: 4 * 98]  # the F407's; the G473's last four are not used
        words = [int.from_bytes(vectors[i : i + 4], "little") for i in range(0, len(vectors), 4)]
        assert words[0] == STACK[board]
        assert words[1] == address["Reset_Handler"] | 1
        for handler in HANDLERS[board] + (SENDERS[board] if name == "gimbal" else []):
            entry = f"{handler}_Handler" if handler == "SysTick" else f"{handler}_IRQHandler"
            assert address[entry] != address["Default_Handler"]
            assert address[entry] | 1 in words
