// Reads worlds (JSON lines of {ground, number, laws}) on stdin and answers with what is hidden, the page's judgement and the
// recordings as a campaign's files and as a zip (base64).
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const at = (name) => import(pathToFileURL(`${process.argv[2]}/play/${name}.js`));
const { hidden, judged, recording } = await at("world"), { campaign, zip } = await at("campaign");
for await (const line of createInterface({ input: process.stdin })) {
  const { ground, number, laws } = JSON.parse(line), recordings = laws.map((law) => ({ law, ...recording(ground, number, law) }));
  const began = performance.now(), judgement = await judged(ground, recordings), ms = performance.now() - began;
  const files = campaign(ground, number, recordings), packed = Buffer.concat(zip(files)).toString("base64");
  console.log(JSON.stringify({ hidden: hidden(ground, number), judgement, files, packed, ms }));
}
