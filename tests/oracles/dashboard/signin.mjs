// Signs in at a server that asks for its key: a wrong key is refused, the right one is kept as a session that no script can read,
// and signing out ends it. Arguments: base address, key. Prints one line of JSON.
import assert from "node:assert/strict";
import { open } from "./browser.mjs";

const [base, key] = process.argv.slice(2);
const { browser, page, seen } = await open(base);
await page.goto(base);
const field = page.locator("#key-form input[name=key]");
await field.waitFor();
const answer = async (text) => { await field.fill(text); await page.keyboard.press("Enter"); };
await answer("not the key of this server");
await page.waitForFunction(() => document.querySelector("#key-problem")?.textContent !== "");
assert.equal(await field.inputValue(), "", "a key is not left in the field");
await answer(key);
await page.locator("#connection[data-connection=live]").waitFor();
assert.equal(await page.locator("#key-form").count(), 0);
await page.locator("#empty").waitFor();
const kept = await page.evaluate(() => JSON.stringify({ ...localStorage, ...sessionStorage, cookie: document.cookie }));
assert.ok(!kept.includes(key) && !kept.includes("vantage_session"), kept);
const cookies = await page.context().cookies();
assert.ok(cookies.some(({ name, httpOnly, sameSite }) => name === "vantage_session" && httpOnly && sameSite === "Strict"), JSON.stringify(cookies));
await page.reload();
await page.locator("#connection[data-connection=live]").waitFor();
assert.equal(await page.locator("#key-form").count(), 0, "a reload stays signed in");
await page.locator(".more > summary").click();
await page.locator("#sign-out").click();
await field.waitFor();
assert.deepEqual(seen.foreign, []);
// The browser writes of each answer 401 to its console; the page adds nothing.
assert.ok(seen.errors.every((text) => text.includes("401")), seen.errors.join("\n"));
await browser.close();
console.log(JSON.stringify({ cookies: cookies.length }));
