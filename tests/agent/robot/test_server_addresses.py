"""Which MCP servers a client may bring: every form of an address, a name, a header and a type, without a socket."""

from __future__ import annotations

from typing import Any

import pytest
from acp.schema import AcpMcpServer, HttpHeader, HttpMcpServer, McpServerStdio, SseMcpServer

from backend import wire
from backend.agent.robot.server_addresses import MAX_SERVERS, Address, AllowList, Offer, ServerRefused

ALLOWED = AllowList(["https://tools.example.org/mcp", "http://127.0.0.1:8300", "https://[::1]:9/a/b/"])


def http(url: str, name: str = "lab", headers: dict[str, str] | None = None) -> HttpMcpServer:
    sent = [HttpHeader(name=key, value=value) for key, value in (headers or {}).items()]
    return HttpMcpServer(type="http", name=name, url=url, headers=sent)


def read(*servers: Any, may_offer: bool = True, allowed: AllowList = ALLOWED) -> tuple[Offer, ...]:
    return allowed.read(servers, role="supervisor" if may_offer else "operator", may_offer=may_offer)


@pytest.mark.parametrize(
    ("url", "dialled"),
    [
        ("https://tools.example.org/mcp", "https://tools.example.org:443/mcp"),
        ("https://tools.example.org/mcp/", "https://tools.example.org:443/mcp/"),
        ("https://tools.example.org:443/mcp/a/b", "https://tools.example.org:443/mcp/a/b"),
        ("HTTPS://Tools.EXAMPLE.org/mcp", "https://tools.example.org:443/mcp"),
        ("https://tools.example.org:0443/mcp", "https://tools.example.org:443/mcp"),
        ("https://tools.example.org/mcp/@some/one", "https://tools.example.org:443/mcp/@some/one"),
        ("http://127.0.0.1:8300", "http://127.0.0.1:8300"),
        ("http://127.0.0.1:8300/any/thing", "http://127.0.0.1:8300/any/thing"),
        ("https://[::1]:9/a/b/c", "https://[::1]:9/a/b/c"),
    ],
)
def test_what_lies_at_or_below_an_address_of_the_list_is_taken(url: str, dialled: str) -> None:
    assert [offer.url for offer in read(http(url))] == [dialled]


@pytest.mark.parametrize(
    "url",
    [
        "https://tools.example.org",  # above
        "https://tools.example.org/",
        "https://tools.example.org/mcpevil",  # no whole segment
        "https://tools.example.org/MCP",
        "https://tools.example.org/other/mcp",
        "http://tools.example.org/mcp",  # another scheme
        "https://tools.example.org:444/mcp",  # another port
        "https://tools.example.org.evil.org/mcp",
        "https://evil.tools.example.org/mcp",
        "https://evil.org/tools.example.org/mcp",
        "http://127.0.0.1/",
        "http://127.0.0.1:8301",
        "http://localhost:8300",
        "http://127.1:8300",
        "http://2130706433:8300",
        "https://[0:0:0:0:0:0:0:1]:9/a/b",
    ],
)
def test_what_is_not_on_the_list_is_refused_with_the_name_of_the_setting(url: str) -> None:
    with pytest.raises(ServerRefused, match=r"not on the list.*agent\.mcp_allow") as refused:
        read(http(url))
    assert refused.value.code == wire.INVALID_PARAMS


@pytest.mark.parametrize(
    "url",
    [
        "https://tools.example.org@evil.org/mcp",
        "https://user:secret@tools.example.org/mcp",
        "https://tools.example.org:secret@evil.org/mcp",
        "https://evil.org\\@tools.example.org/mcp",
        "https://evil.org\\.tools.example.org/mcp",
        "https://tools.example.org/mcp#secret",
        "https://tools.example.org/mcp?key=secret",
        "https://tools.example.org/mcp/../admin",
        "https://tools.example.org/mcp/..",
        "https://tools.example.org/mcp/./x",
        "https://tools.example.org/mcp/.../x",
        "https://tools.example.org/mcp/..;/admin",
        "https://tools.example.org/mcp/%2e%2e/admin",
        "https://tools.example.org/mcp/%252e%252e/admin",
        "https://tools.example.org/mcp%2f..%2fadmin",
        "https://tools.example.org/mcp%5c..%5cadmin",
        "https://tools.example.org/mcp\\..\\admin",
        "https://tools.example.org//mcp",
        "https://tools.example.org/mcp//x",
        "https://tools.example.org/mcp\n",
        "https://tools.example.org/mcp\r\nX-Key: secret",
        " https://tools.example.org/mcp",
        "https://tools.example.org\t/mcp",
        "https:///tools.example.org/mcp",
        "https:tools.example.org/mcp",
        "//tools.example.org/mcp",
        "tools.example.org/mcp",
        "https://tools.example.org:/mcp",
        "https://tools.example.org:-1/mcp",
        "https://tools.example.org:0/mcp",
        "https://tools.example.org:70000/mcp",
        "https://tools.example.org:443x/mcp",
        "https://tools.example.org./mcp",
        "https://tools.example。org/mcp",
        "https://tools.example.org/mcp/\u212a",
        "https://too\u2113s.example.org/mcp",
        "https://tools.example.org/mcp" + "/x" * 2000,
        "https://[::1%25eth0]:9/a/b",
        "file:///etc/passwd",
        "stdio:/bin/sh",
        "",
        "\0",
    ],
)
def test_an_address_that_parsers_could_read_in_two_ways_is_refused_and_not_repeated(url: str) -> None:
    with pytest.raises(ServerRefused, match="address of the MCP server lab cannot be used") as refused:
        read(http(url))
    assert "secret" not in str(refused.value)
    assert "evil" not in str(refused.value)


@pytest.mark.parametrize("entry", ["https://u@x.org", "x.org/mcp", "https://x.org/../y", "https://x.org/?a", ""])
def test_an_entry_of_the_list_that_is_no_address_is_named(entry: str) -> None:
    with pytest.raises(ValueError, match=r"agent\.mcp_allow: entry 2 cannot be used"):
        AllowList(["https://x.org", entry])


def test_the_empty_list_takes_nothing() -> None:
    assert not AllowList([])
    assert read(allowed=AllowList([])) == ()
    with pytest.raises(ServerRefused, match=r"agent\.mcp_allow"):
        read(http("https://tools.example.org/mcp"), allowed=AllowList([]))


def test_what_was_checked_is_what_is_dialled() -> None:
    for text in ("https://x.org", "http://x.org:8080/a/b/", "https://[fe80::1]/x"):
        address = Address.parse(text)
        assert Address.parse(str(address)) == address


@pytest.mark.parametrize("may_offer", [True, False])
@pytest.mark.parametrize(
    ("server", "said"),
    [
        (McpServerStdio(name="x", command="/bin/sh", args=[], env=[]), "commands on the robot's computer"),
        (SseMcpServer(type="sse", name="x", url="https://tools.example.org/mcp", headers=[]), "of the type sse"),
        (AcpMcpServer(type="acp", name="x", server_id="1"), "of the type acp"),
    ],
)
def test_what_is_not_http_is_refused_to_everybody(server: Any, said: str, may_offer: bool) -> None:
    with pytest.raises(ServerRefused, match=said) as refused:
        read(http("https://tools.example.org/mcp"), server, may_offer=may_offer)
    assert refused.value.code == wire.INVALID_PARAMS


def test_only_who_may_offer_offers() -> None:
    with pytest.raises(ServerRefused, match="your role is operator") as refused:
        read(http("https://tools.example.org/mcp"), may_offer=False)
    assert refused.value.code == wire.NOT_ALLOWED
    assert read(may_offer=False) == ()


@pytest.mark.parametrize("name", ["", "a b", "a__b", "_a", "a_", "ä", "a.b", "a/b", "a\n", "x" * 25])
def test_a_name_that_would_make_no_name_of_a_tool_is_refused(name: str) -> None:
    with pytest.raises(ServerRefused, match="name of an MCP server begins the names of its tools"):
        read(http("https://tools.example.org/mcp", name))


def test_names_are_there_once() -> None:
    one, other = http("https://tools.example.org/mcp", "Lab"), http("http://127.0.0.1:8300", "lab")
    with pytest.raises(ServerRefused, match="Two of the MCP servers are called lab"):
        read(one, other)


def test_there_are_not_too_many() -> None:
    servers = [http("https://tools.example.org/mcp", f"lab{number}") for number in range(MAX_SERVERS + 1)]
    assert len(read(*servers[1:])) == MAX_SERVERS
    with pytest.raises(ServerRefused, match=f"at most {MAX_SERVERS} MCP servers; these are {MAX_SERVERS + 1}"):
        read(*servers)


@pytest.mark.parametrize(
    ("headers", "said"),
    [
        ({"X-Key": "secret\r\nHost: evil.org"}, "Header 1 .* value that is not taken"),
        ({"X-Key": "secret\0"}, "Header 1 .* value that is not taken"),
        ({"X-Key": "sécret"}, "Header 1 .* value that is not taken"),
        ({"X-Key": "secret" * 2000}, "Header 1 .* value that is not taken"),
        ({"A": "b", "X Key": "secret"}, "Header 2 .* name that HTTP does not take"),
        ({"X-Key: secret": ""}, "Header 1 .* name that HTTP does not take"),
        ({"": "secret"}, "Header 1 .* name that HTTP does not take"),
        ({"X-Key": "secret", "x-key": "secret"}, "Header 2 .* is there twice"),
        ({"Host": "secret.example.org"}, "belongs to the connection itself"),
        ({"Content-Length": "0"}, "belongs to the connection itself"),
        ({"Transfer-Encoding": "chunked"}, "belongs to the connection itself"),
        ({"Mcp-Session-Id": "secret"}, "belongs to the connection itself"),
        ({"X-Forwarded-Host": "secret"}, "belongs to the connection itself"),
        ({f"X-{number}": "secret" for number in range(33)}, "at most 32"),
    ],
)
def test_a_header_that_is_not_taken_is_named_by_its_number_alone(headers: dict[str, str], said: str) -> None:
    with pytest.raises(ServerRefused, match=said) as refused:
        read(http("https://tools.example.org/mcp", headers=headers))
    assert "secret" not in str(refused.value)


def test_headers_go_along_and_are_not_shown() -> None:
    (offer,) = read(http("https://tools.example.org/mcp", headers={"Authorization": "Bearer secret", "X-Key": ""}))
    assert offer.headers == {"authorization": "Bearer secret", "x-key": ""}
    assert "secret" not in repr(offer)
