"""A user of the real openpi-client, run in an environment of its own: no import of betterbench, NumPy 1.

It reads observations from its standard input and drives a server with them, so that the process that holds the
environment needs neither openpi-client nor its NumPy: one JSON line in, one JSON line out.
"""

import base64
import json
import sys

import numpy as np
from openpi_client import action_chunk_broker, image_tools, websocket_client_policy


def decode(value):
    """Returns arrays where the line marks them."""
    if isinstance(value, dict) and "array" in value:
        data = base64.b64decode(value["array"])
        return np.frombuffer(data, dtype=value["dtype"]).reshape(value["shape"])
    return value


def main():
    """Connects, says what the server declares, and answers every line until there are no more."""
    port, broker = int(sys.argv[1]), int(sys.argv[2])
    policy = websocket_client_policy.WebsocketClientPolicy(host="127.0.0.1", port=port)
    say({"numpy": np.__version__, "metadata": policy.get_server_metadata()})
    if broker:
        policy = action_chunk_broker.ActionChunkBroker(policy, action_horizon=broker)
    for line in sys.stdin:
        observation = {key: decode(value) for key, value in json.loads(line).items()}
        for key in ("observation/image", "observation/wrist_image"):
            if key in observation:
                observation[key] = image_tools.resize_with_pad(observation[key], 224, 224)
        try:
            actions = np.asarray(policy.infer(observation)["actions"])
        except RuntimeError as error:
            say({"error": str(error)})
            return
        say({"actions": actions.tolist(), "dtype": str(actions.dtype), "shape": actions.shape})


def say(answer):
    """Writes one line."""
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
