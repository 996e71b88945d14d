"""Clients for vision-language models: endpoints that use OpenAI's chat protocol, and a scripted model."""

from betterbench.vqa.llm.cache import ReplyCache
from betterbench.vqa.llm.chat import Chat, ChatEndpoint, Message, RefusedError, ScriptedChat, user_message
from betterbench.vqa.llm.model import ChatModel, Model, endpoint_at
from betterbench.vqa.llm.reply import Reply

__all__ = [
    "Chat",
    "ChatEndpoint",
    "ChatModel",
    "Message",
    "Model",
    "RefusedError",
    "Reply",
    "ReplyCache",
    "ScriptedChat",
    "endpoint_at",
    "user_message",
]
