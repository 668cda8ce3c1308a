// The Markdown that `wirebond doc` writes, as HTML: headings, tables, lists, code, emphasis. Every character of the text is
// escaped first, so that nothing in a protocol file becomes an element.

const escaped = (text: string) =>
  text
    .replace(/&/g, "&amp;")
    .replace(/</g, "&lt;")
    .replace(/>/g, "&gt;")
    .replace(/"/g, "&quot;")
    .replace(/'/g, "&#39;");

function inline(text: string): string {
  return escaped(text)
    .split(/(`[^`]+`)/)
    .map((part) =>
      part.startsWith("`") && part.endsWith("`") && part.length > 2
        ? `<code>${part.slice(1, -1)}</code>`
        : part
            .replace(/\[([^\]]+)\]\([^)]*\)/g, "$1")
            .replace(/\*\*([^*]+)\*\*/g, "<strong>$1</strong>")
            .replace(/\*([^*]+)\*/g, "<em>$1</em>")
            .replace(/\\([|*_`\\])/g, "$1")
            .replace(/&lt;br ?\/?&gt;/g, "<br>"),
    )
    .join("");
}

/** The cells of a row of a table; `\|` does not end one. */
function cells(line: string): string[] {
  return line
    .trim()
    .replace(/^\|/, "")
    .replace(/\|$/, "")
    .split(/(?<!\\)\|/)
    .map((cell) => cell.trim());
}

export function markdownToHtml(markdown: string): string {
  const lines = markdown.split("\n");
  const out: string[] = [];
  let at = 0;
  while (at < lines.length) {
    const line = lines[at]!;
    const fence = /^```/.test(line);
    const heading = /^(#{1,4}) (.*)$/.exec(line);
    if (fence) {
      const code: string[] = [];
      for (at++; at < lines.length && !lines[at]!.startsWith("```"); at++) code.push(lines[at]!);
      out.push(`<pre tabindex="0"><code>${escaped(code.join("\n"))}</code></pre>`);
      at++;
    } else if (heading) {
      const level = heading[1]!.length;
      out.push(`<h${level}>${inline(heading[2]!)}</h${level}>`);
      at++;
    } else if (line.startsWith("|") && /^\|[\s:|-]+\|?$/.test(lines[at + 1] ?? "")) {
      const right = cells(lines[at + 1]!).map((cell) => cell.endsWith(":"));
      const row = (tag: string, text: string) =>
        `<tr>${cells(text)
          .map((cell, index) => `<${tag}${right[index] ? ' class="number"' : ""}>${inline(cell)}</${tag}>`)
          .join("")}</tr>`;
      out.push(`<table><thead>${row("th", line)}</thead><tbody>`);
      for (at += 2; at < lines.length && lines[at]!.startsWith("|"); at++) out.push(row("td", lines[at]!));
      out.push("</tbody></table>");
    } else if (/^[-*] /.test(line)) {
      out.push("<ul>");
      for (; at < lines.length && /^([-*] | {2,}\S)/.test(lines[at]!); at++)
        out.push(/^[-*] /.test(lines[at]!) ? `<li>${inline(lines[at]!.slice(2))}` : ` ${inline(lines[at]!.trim())}`);
      out.push("</ul>");
    } else if (line.trim() === "") {
      at++;
    } else {
      const text: string[] = [];
      for (; at < lines.length && lines[at]!.trim() !== "" && !/^(#|```|\||[-*] )/.test(lines[at]!); at++)
        text.push(lines[at]!);
      if (text.length === 0) text.push(lines[at++]!);
      out.push(`<p>${inline(text.join(" "))}</p>`);
    }
  }
  return out.join("\n");
}
