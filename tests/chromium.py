"""A Chromium without a window, for the tests that look at pages as people do."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import pytest


@contextmanager
def started(size: str, env: Mapping[str, str] | None = None, **capabilities: Any) -> Iterator[Any]:
    """Selenium's driver of one; the test is skipped where none is installed.

    size : 'width,height' of the window, px
    env : environment of the browser; None is this process' own
    """
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not chromium or not driver:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium chromium-driver)")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", f"--window-size={size}"):
        options.add_argument(argument)
    for name, value in capabilities.items():
        options.set_capability(name, value)
    found = webdriver.Chrome(options, webdriver.ChromeService(driver, env=env))
    yield found
    found.quit()
