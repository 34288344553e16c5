// node listen.mjs ADDRESS: what Foxglove's client hears there, one thing a line; and it tries to do something, as a viewer could.
import protocol from "@foxglove/ws-protocol";
import WebSocket from "ws";

import { readerOf, say } from "./decoded.mjs";

const { FoxgloveClient } = protocol; // it is a module of the old kind
// Foxglove's server has taken the place of its protocol's first name.
const socket = new WebSocket(process.argv[2], ["foxglove.sdk.v1", FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
const readers = new Map(), channels = new Map();
client.on("error", (error) => { throw error; });
client.on("close", () => process.exit(0));
client.on("status", (status) => say({ status }));
client.on("serverInfo", ({ capabilities }) => {
  say({ capabilities });
  const setpoint = client.advertise({ topic: "/sma_actuator/setpoint", encoding: "cdr", schemaName: "std_msgs/msg/Float64" });
  client.sendMessage(setpoint, new Uint8Array([0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]));
});
client.on("advertise", (offered) => {
  for (const channel of offered) {
    channels.set(client.subscribe(channel.id), channel);
    readers.set(channel.id, readerOf(channel.schema));
  }
});
client.on("message", ({ subscriptionId, data }) => {
  const channel = channels.get(subscriptionId);
  say({ topic: channel.topic, type: channel.schemaName, message: readers.get(channel.id).readMessage(data) });
});
process.stdin.on("end", () => client.close()).resume();
