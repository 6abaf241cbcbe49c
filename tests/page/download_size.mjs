// What comes over the line: the first visit in less than 520 kB, the second one mostly from the browser's memory.

const MAX_BYTES = 520_000;

export async function downloadSize(page, { url, check, screenshot }) {
  const line = await page.context().newCDPSession(page);
  await line.send("Network.enable");
  let requests = new Map();
  line.on("Network.requestWillBeSent", ({ requestId, request }) => requests.set(requestId, { url: request.url, bytes: 0, kept: false }));
  line.on("Network.requestServedFromCache", ({ requestId }) => requests.has(requestId) && (requests.get(requestId).kept = true));
  line.on("Network.responseReceived", ({ requestId, response }) => requests.has(requestId) && (requests.get(requestId).kept ||= response.fromDiskCache));
  line.on("Network.loadingFinished", ({ requestId, encodedDataLength }) => requests.has(requestId) && (requests.get(requestId).bytes = encodedDataLength));
  const visit = async () => {
    requests = new Map();
    await page.goto(new URL("?quality=3&tutorial=0&pictures=10", url).href);
    await page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
    // Meshes that come after the first picture count, too.
    await page.waitForLoadState("networkidle");
    return [...requests.values()];
  };
  const sum = (list) => list.reduce((bytes, request) => bytes + request.bytes, 0);
  const first = await visit();
  const largest = [...first].sort((a, b) => b.bytes - a.bytes).slice(0, 5);
  for (const request of largest) console.log(`    ${new URL(request.url).pathname}: ${Math.round(request.bytes / 1000)} kB`);
  check(first.some(({ url: address }) => address.includes("/app-")), "the script has a hash in its name");
  check(sum(first) > 50_000 && sum(first) < MAX_BYTES, `the first visit takes ${Math.round(sum(first) / 1000)} kB in ${first.length} requests`);
  await screenshot("loaded");
  const second = await visit();
  const again = second.filter(({ url: address, kept }) => /-[A-Z0-9]{8}\./.test(address) && !kept);
  check(again.length === 0, `what has a hash in its name is kept: ${again.map(({ url: address }) => address).join(", ") || "nothing is asked for again"}`);
  check(sum(second) < sum(first), `the second visit takes ${Math.round(sum(second) / 1000)} kB`);
}
