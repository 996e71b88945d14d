"""Clients of models that see images: any endpoint with the chat protocol of OpenAI, and a scripted one."""

from betterbench.vqa.llm.chat import Chat, ChatEndpoint, Message, RefusedError, ScriptedChat, user_message

__all__ = ["Chat", "ChatEndpoint", "Message", "RefusedError", "ScriptedChat", "user_message"]
