"""Clients for vision-language models: endpoints with OpenAI's chat protocol, and a scripted model."""

from betterbench.vqa.llm.chat import Chat, ChatEndpoint, Message, RefusedError, ScriptedChat, user_message

__all__ = ["Chat", "ChatEndpoint", "Message", "RefusedError", "ScriptedChat", "user_message"]
