// One twin and one browser for all tests: both take seconds to start.
import { after } from 'node:test';
import { TwinBox } from '../twin/box';
import { chromiumProgram, Desk, launch, seed, site } from './browser';

if (!chromiumProgram()) {
  console.log('skipped: no chromium (apt-get install chromium)');
  process.exit(77);
}
console.log(`seed ${seed}`);

export const twin = new TwinBox(site, seed);
export const { plant } = twin;
await twin.listen();
export const browser = await launch();
export const context = await browser.newContext({ viewport: { width: 1280, height: 720 },
  colorScheme: 'dark' });
export const desk = await Desk.open(context, twin);

after(async () => {
  await browser.close();
  await twin.close();
});
