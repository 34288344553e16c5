// node open_mcap.mjs RECORDING.mcap: every message of it, one a line, as Foxglove's own packages read it.
import { McapIndexedReader } from "@mcap/core";
import { open } from "node:fs/promises";

import { readerOf, say } from "./decoded.mjs";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, size) => {
    const bytes = new Uint8Array(Number(size));
    await file.read(bytes, 0, bytes.length, Number(offset));
    return bytes;
  },
};
const recording = await McapIndexedReader.Initialize({ readable });
const readers = new Map();
for await (const { channelId, logTime, data } of recording.readMessages()) {
  const channel = recording.channelsById.get(channelId);
  const schema = recording.schemasById.get(channel.schemaId);
  if (!readers.has(schema.id)) readers.set(schema.id, readerOf(new TextDecoder().decode(schema.data)));
  say({ topic: channel.topic, type: schema.name, encoding: [channel.messageEncoding, schema.encoding], logTime, message: readers.get(schema.id).readMessage(data) });
}
await file.close();
