"""The page in Chinese: what the server says, the protocol's document, and what happened; changed at once."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

from tests.console.browser import Desk, shows_the_robot
from wirebond.chinese import chinese

pytestmark = pytest.mark.live


def in_chinese(rover: Desk, view: str) -> Page:
    page = rover.page(view, locale="zh-CN")
    expect(page.get_by_role("button", name="急停")).to_be_visible()
    return page


def test_a_refusal_of_the_server_and_the_document_are_chinese_and_change_with_the_language(rover: Desk) -> None:
    page = in_chinese(rover, "protocol")
    document = page.locator("article.document")
    expect(document).to_contain_text("由上位机发送，每 50 ms 一次。")  # noqa: RUF001
    expect(document).to_contain_text("Wanted speed of the base.")  # the file's own words
    page.keyboard.press("l")
    expect(document).to_contain_text("Sent by the host, every 50 ms.".replace("Sent", "sent"))
    page.keyboard.press("l")
    page.get_by_role("tab", name="解释字节").click()
    page.locator("main").get_by_role("textbox").first.fill("these are none")
    page.get_by_role("button", name="解释", exact=True).click()
    expect(page.get_by_text("这不是字节；请给出成对的十六进制数字")).to_be_visible()  # noqa: RUF001


def test_why_the_link_is_down_is_chinese_in_the_header_and_among_the_events(rover: Desk) -> None:
    page = in_chinese(rover, "link")
    rover.robot.kill()
    try:
        why = page.locator("header .why")
        expect(why).to_contain_text("没有串口")
        assert chinese(rover.link.why) == why.inner_text()
        expect(page.get_by_text(re.compile("串口断开：.*已断开（"))).not_to_have_count(0)  # noqa: RUF001
        page.keyboard.press("l")
        expect(why).to_have_text(rover.link.why)
    finally:
        rover.robot.start()
    shows_the_robot(page)


def test_a_value_that_was_not_set_again_is_reported_in_chinese(rover: Desk) -> None:
    page = in_chinese(rover, "link")
    rover.robot.ready(rover.link)
    rover.link.repeat("velocity", linear=0.1, angular=0.0, hold=0.05)
    expect(page.get_by_text("停止重复发送 velocity：没有及时续发")).not_to_have_count(0)  # noqa: RUF001
    page.keyboard.press("l")
    expect(page.get_by_text("velocity is no longer repeated: not set again in time")).not_to_have_count(0)
