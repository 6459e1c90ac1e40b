// One Pico with the image `heater` behind standard input and output, and a simulated block at its converter and its PWM.
//
// usage: serve-heater.mjs IMAGE WHICH TICK_S REPORT [stuck|unwired]      WHICH: of the blocks, 0 to 2; TICK_S: seconds that pass from a conversion
// to the next; REPORT: a file that says at the end what became of the block
import fs from 'node:fs';
import { Block } from './block.mjs';
import { pico, serve } from './served.mjs';

const [image, which, tick, report, fault] = process.argv.slice(2);
const board = pico({ image });
const block = new Block(board, Number(which), Number(tick), fault);
process.on('SIGTERM', () => {
  fs.writeFileSync(report, JSON.stringify({ celsius: block.celsius, conversions: block.conversions, drive: block.drive() }));
  process.exit(0);
});
serve(board);
