"""OpenAI's newer interface, `/responses`: `openai:MODEL#api=responses`.

The same question, the same strict schema, the same deadline; only the form on the wire differs.
Nothing is kept at the server (`store` is false).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sandra.rankers.endpoint import Content, Endpoint, Question
from sandra.rankers.stream import Reply, decoded
from sandra.rankers.types import Failure
from sandra.rankers.usage import told_by_server


@decoded
def take(body: Any, reply: Reply) -> None:
    """Take one event of a stream, or one whole response."""
    if not isinstance(body, dict):
        body = {}
    kind = body.get("type")
    if kind == "error" or (kind is None and body.get("error")):
        reply.fail(body.get("error") or body)
    elif kind == "response.output_text.delta":
        reply.add(body.get("delta"))
    elif kind == "response.refusal.delta":
        reply.refuse(body.get("delta"))
    elif kind in ("response.completed", "response.incomplete", "response.failed"):
        _end(body.get("response"), reply)
    elif kind is None and body.get("object") == "response":
        for part in _parts(body):
            reply.add(part.get("text") if part.get("type") == "output_text" else None)
            reply.refuse(part.get("refusal") if part.get("type") == "refusal" else None)
        _end(body, reply)
    elif not isinstance(kind, str):
        reply.failure, reply.detail = Failure.MALFORMED, "the server sent no response"


def _end(response: Any, reply: Reply) -> None:
    """How it ended: whole, too long, stopped by the content filter, or broken."""
    if not isinstance(response, dict):
        return
    reply.usage = told_by_server(response.get("usage")) or reply.usage
    if response.get("error"):
        reply.fail(response["error"])
    why = response.get("incomplete_details")
    reason = why.get("reason") if isinstance(why, dict) else None
    finishes = {"max_output_tokens": "length", "content_filter": "content_filter"}
    reply.finish = finishes.get(str(reason), "stop")
    reply.ended_early = reply.ended_early or response.get("status") == "incomplete"


def _parts(response: dict[str, Any]) -> Iterator[dict[str, Any]]:
    output = response.get("output")
    for item in output if isinstance(output, list) else []:
        content = item.get("content") if isinstance(item, dict) else None
        for part in content if isinstance(content, list) else []:
            if isinstance(part, dict):
                yield part


def _content(content: Content) -> Content:
    """A message's content in this API's words: its parts have other names."""
    if isinstance(content, str):
        return content
    return [
        {"type": "input_text", "text": part["text"]}
        if part["type"] == "text"
        else {"type": "input_image", "image_url": part["image_url"]["url"]}
        for part in content
    ]


class ResponsesEndpoint(Endpoint):
    """`/responses` of one server for one model; see `Endpoint`."""

    path = "responses"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._take = take

    def _service(self) -> Any:
        return self._client.responses.with_streaming_response

    def _body(self, question: Question) -> dict[str, Any]:
        chat = super()._body(question)
        body = {"model": chat["model"], "store": False}
        body["input"] = [{**m, "content": _content(m["content"])} for m in chat["messages"]]
        if "response_format" in chat:
            schema = chat["response_format"]["json_schema"]
            body["text"] = {"format": {"type": "json_schema", **schema}}
        return body
