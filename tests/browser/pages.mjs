// Reports in headless Chromium: how they are made, and what no page may do.
import { execFileSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import puppeteer from 'puppeteer-core';

const AXE = readFileSync(createRequire(import.meta.url).resolve('axe-core'), 'utf8');
const ROOT = join(import.meta.dirname ?? new URL('.', import.meta.url).pathname, '..', '..');

// Runs the command; exit code 1 is a verdict that does not hold.
export function simHost(...words) {
  try {
    execFileSync(join(ROOT, 'target/debug/sim-host'), words, { cwd: ROOT, stdio: ['ignore', 'ignore', 'pipe'] });
  } catch (error) {
    if (error.status !== 1) throw error;
  }
}

export const browser = () =>
  puppeteer.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: ['--no-sandbox', '--disable-gpu', '--allow-file-access-from-files', '--force-color-profile=srgb'],
  });

export const WIDTHS = [400, 1400];

// Opens a file and gives the page and what it has complained of or asked for meanwhile.
export async function open(browser, file, { width = 1400, scheme = 'light', media = 'screen' } = {}) {
  const page = await browser.newPage(), complaints = [], asked = [];
  const url = pathToFileURL(file).href;
  page.on('console', (message) => complaints.push(message.text()));
  page.on('pageerror', (error) => complaints.push(String(error)));
  page.on('request', (request) => request.url() === url || asked.push(request.url()));
  await page.setViewport({ width, height: 900 });
  await page.emulateMediaType(media);
  await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: scheme }]);
  await page.goto(url, { waitUntil: 'load' });
  return { page, complaints, asked };
}

// Everything that is wrong with a page, in words.
export async function faults({ page, complaints, asked }) {
  const found = [...complaints.map((text) => `says ${text}`), ...asked.map((address) => `asks for ${address}`)];
  found.push(...(await page.evaluate(looks)), ...(await unreadable(page)));
  return found;
}

// Runs in the page.
function looks() {
  const found = [], root = document.documentElement;
  if (root.scrollWidth > root.clientWidth) found.push(`is ${root.scrollWidth} wide in ${root.clientWidth}`);
  // Parts that are folded have no size.
  const isFolded = (element) => element.closest('details:not([open])') !== null;
  for (const picture of document.querySelectorAll('svg, img')) {
    const { width, height } = picture.getBoundingClientRect();
    if (!isFolded(picture) && (width < 100 || height < 40)) found.push(`has a picture of ${width} x ${height}`);
  }
  // Words of a picture that stick out of it are cut off.
  for (const words of document.querySelectorAll('svg text')) {
    const { left, right, top, bottom, width } = words.getBoundingClientRect(), edge = words.closest('svg').getBoundingClientRect();
    const out = Math.max(edge.left - left, right - edge.right, edge.top - top, bottom - edge.bottom);
    if (width > 0 && out > 2) found.push(`cuts off "${words.textContent}" by ${Math.round(out)} pixels`);
  }
  return found;
}

// What axe finds by the rules of WCAG 2, contrast and text alternatives among them.
async function unreadable(page) {
  await page.evaluate(AXE);
  const { violations } = await page.evaluate(() => axe.run(document, { resultTypes: ['violations'] }));
  return violations.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.slice(0, 3).map((node) => node.html.slice(0, 120)).join(' ')}`);
}
