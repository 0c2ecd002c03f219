// Reads questions (JSON lines) on stdin and answers each with the page's own numbers; tolerance of a step: argument.
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const [, , folder, tolerance] = process.argv;
const { numbersOf } = await import(pathToFileURL(`${folder}/physics/jump.js`));
for await (const line of createInterface({ input: process.stdin })) {
  const began = performance.now(), numbers = numbersOf(JSON.parse(line), Number(tolerance));
  console.log(JSON.stringify({ ...numbers, ms: performance.now() - began }));
}
