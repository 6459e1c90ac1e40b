// What a reader of a report sees, on a phone, on a desk, on paper.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { WIDTHS, browser, faults, open, simHost } from './pages.mjs';

const place = mkdtempSync(join(tmpdir(), 'reports-')), at = (...names) => join(place, ...names);
const FIVE = 'scenarios/five-agents.toml';
let chromium;

before(async () => {
  const short = ['-q', '--set', 'time.duration=500ms'];
  simHost('run', FIVE, ...short, '--set', 'bus.model=can', '--out', at('can'));
  simHost('run', 'scenarios/partition.toml', '-q', '--out', at('events'));
  simHost('run', FIVE, ...short, '--set', 'coupling.funnel.end=1e-3', '--out', at('fails'));
  simHost('sweep', FIVE, '-q', '--set', 'time.duration=200ms', '--grid', 'bus.loss=0,0.1,0.2', '--seeds', '3', '--out', at('sweep'));
  simHost('sweep', FIVE, '-q', '--set', 'time.duration=20ms', '--grid', 'bus.loss=0,0.1', '--out', at('calm'));
  for (const name of ['can', 'events', 'fails', 'sweep', 'calm']) simHost('report', at(name));
  simHost('report', at('can'), at('fails'), '--html', at('both.html'));
  chromium = await browser();
});

after(async () => {
  await chromium?.close();
  rmSync(place, { recursive: true });
});

const REPORTS = { run: 'can/report.html', events: 'events/report.html', failed: 'fails/report.html', sweep: 'sweep/report.html', 'sweep that passes': 'calm/report.html', comparison: 'both.html' };

for (const [name, file] of Object.entries(REPORTS)) {
  for (const width of WIDTHS) {
    for (const scheme of ['light', 'dark']) {
      test(`${name}, ${width} pixels, ${scheme}: nothing is cut off, asked for, complained of or unreadable`, async () => {
        const opened = await open(chromium, at(file), { width, scheme });
        assert.deepEqual(await faults(opened), []);
        await opened.page.close();
      });
    }
  }
  test(`${name} on paper: what is folded on a screen is open`, async () => {
    const { page } = await open(chromium, at(file), { width: 800, media: 'print' });
    const hidden = await page.$$eval('details > :not(summary)', (parts) => parts.filter((part) => part.getBoundingClientRect().height === 0).length);
    const parts = await page.$$eval('details', (all) => all.length);
    if (!name.startsWith('sweep')) assert.ok(parts > 0);
    assert.equal(hidden, 0);
    const pdf = await page.pdf({ format: 'A4' });
    assert.equal(Buffer.from(pdf.subarray(0, 5)).toString(), '%PDF-');
    await page.close();
  });
}

// 127 nodes for a minute, as `a_run_of_127_nodes` of sim-host/tests/report.rs has them. How long it takes is told; only a page that hangs fails.
const MANY = `version = 1
time = { tick = "10ms", duration = "60s" }
graph = { kind = "ring-lattice", nodes = 127, degree = 4 }
coupling = { kind = "node-wise", gain = { kind = "reciprocal", scale = 1.0 }, funnel = { kind = "constant", width = 30.0 } }
agent = { dynamics = { kind = "affine", slope = -1.0, offset = 1.0 }, noise = 1.0 }
`;
test('a report of 127 nodes over a minute opens', { timeout: 120_000 }, async (t) => {
  writeFileSync(at('many.toml'), MANY);
  simHost('run', at('many.toml'), '-q', '--out', at('many'));
  simHost('report', at('many'));
  for (const width of WIDTHS) {
    const began = performance.now();
    const { page, complaints, asked } = await open(chromium, at('many/report.html'), { width });
    await page.evaluate(() => new Promise((shown) => requestAnimationFrame(() => requestAnimationFrame(shown))));
    t.diagnostic(`${width} pixels: shown after ${Math.round(performance.now() - began)} ms`);
    assert.deepEqual([complaints, asked], [[], []]);
    assert.equal(await page.$$eval('svg', (pictures) => pictures.length), 4);
    await page.close();
  }
});

// The first column that has numbers that are not in order.
async function column(page) {
  return page.evaluate(() => {
    const [table] = document.querySelectorAll('table.sorts');
    return [...table.tHead.rows[0].cells].findIndex((_, i) => {
      const values = [...table.tBodies[0].rows].map((row) => row.cells[i].dataset.v ?? row.cells[i].textContent);
      return values.every((value) => value !== '' && !Number.isNaN(Number(value))) && values.some((value, j) => j > 0 && Number(value) < Number(values[j - 1]));
    });
  });
}

const values = (page, i) => page.$$eval('table.sorts tbody tr', (rows, i) => rows.map((row) => Number(row.cells[i].dataset.v ?? row.cells[i].textContent)), i);

test('the table of a sweep sorts by mouse and by keyboard, up and down', async () => {
  const { page, complaints } = await open(chromium, at('sweep/report.html'));
  const i = await column(page), before = await values(page, i);
  const up = [...before].sort((a, b) => a - b), button = `table.sorts thead th:nth-child(${i + 1}) button`;
  assert.notDeepEqual(before, up);
  await page.click(button);
  assert.deepEqual(await values(page, i), up);
  await page.focus(button);
  await page.keyboard.press('Enter');
  assert.deepEqual(await values(page, i), [...up].reverse());
  assert.equal(await page.$eval(`table.sorts thead th:nth-child(${i + 1})`, (head) => head.ariaSort), 'descending');
  assert.deepEqual(complaints, []);
  await page.close();
});

// The checks above see what is broken.
const BROKEN = {
  'asks for': (html) => html.replace('</main>', '<img src="other.png" alt="a picture"></main>').replace(/<meta http-equiv[^>]*>/, ''),
  'says ': (html) => html.replace('</main>', '<script>alert(1)</script></main>'),
  'cuts off': (html) => html.replace('</text>', '</text><text x="-30" y="50">outside</text>'),
  ' wide in ': (html) => html.replace('</main>', '<div style="width:3000px">wide</div></main>'),
  'color-contrast': (html) => html.replace('</main>', '<p style="color:#ddd;background:#eee">pale</p></main>'),
  'svg-img-alt': (html) => html.replace('</main>', '<svg role="img" width="200" height="200"></svg></main>'),
  'a picture of': (html) => html.replace('</main>', '<svg width="5" height="5"></svg></main>'),
};

test('a page that is broken is not passed', async () => {
  const html = readFileSync(at('can/report.html'), 'utf8');
  for (const [words, spoil] of Object.entries(BROKEN)) {
    const spoilt = spoil(html);
    assert.notEqual(spoilt, html, words);
    writeFileSync(at('broken.html'), spoilt);
    const opened = await open(chromium, at('broken.html'), { width: 1400 });
    const found = await faults(opened);
    assert.ok(found.some((fault) => fault.includes(words)), `${words} in ${JSON.stringify(found)}`);
    await opened.page.close();
  }
  const changed = readFileSync(at('sweep/report.html'), 'utf8').replace('"use strict";', '"use strict"; ');
  writeFileSync(at('broken.html'), changed);
  const { page } = await open(chromium, at('broken.html'));
  assert.equal(await page.$('table.sorts thead button'), null, 'a script of another hash has run');
  await page.close();
});

test('screenshots, where they are asked for', { skip: !process.env.SCREENSHOTS && 'SCREENSHOTS names no folder' }, async () => {
  for (const [name, file] of Object.entries(REPORTS)) {
    for (const width of WIDTHS) {
      const { page } = await open(chromium, at(file), { width });
      const path = join(process.env.SCREENSHOTS, `${name.replaceAll(' ', '-')}-${width}.png`);
      await page.screenshot({ path, fullPage: true });
      assert.ok(existsSync(path) && statSync(path).size > 10_000);
      await page.close();
    }
  }
});
