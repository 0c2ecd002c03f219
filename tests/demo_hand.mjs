// Reads motions by hand (JSON lines of {t, x, at}) on stdin and answers with X, X', X'' at the times `at`.
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const { handPieces, motorAt, peakSpeed } = await import(pathToFileURL(`${process.argv[2]}/physics/law.js`));
for await (const line of createInterface({ input: process.stdin })) {
  const { t, x, at } = JSON.parse(line), pieces = handPieces({ t, x });
  console.log(JSON.stringify({ motion: at.map((s) => motorAt(pieces, s)), end: pieces.at(-1)[1], peak: peakSpeed(pieces) }));
}
